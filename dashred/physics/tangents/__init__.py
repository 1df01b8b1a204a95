"""Derivatives of trajectories with respect to initial state, coefficients and forcing."""
