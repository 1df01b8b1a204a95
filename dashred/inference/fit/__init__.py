"""Least squares through the simulator, and the selection of a law."""
