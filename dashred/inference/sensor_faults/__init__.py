"""Faults of sensors: kinds, candidates, and their search on a linearised problem."""
