"""Linear algebra that several layers need."""
