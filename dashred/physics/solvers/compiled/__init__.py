"""Time steps in machine code."""
