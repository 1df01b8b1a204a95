"""Grids and their differential operators."""
