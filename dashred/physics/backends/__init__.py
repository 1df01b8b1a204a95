"""Expressions as code: NumPy, Numba, torch, plain numbers."""
