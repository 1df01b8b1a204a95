"""Derivatives of runs with respect to start, law and forcing."""
