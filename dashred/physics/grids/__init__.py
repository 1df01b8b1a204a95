"""Grids, differential operators and quadrature."""
