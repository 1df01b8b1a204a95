"""Boundary conditions that differ between the sides of an axis."""
