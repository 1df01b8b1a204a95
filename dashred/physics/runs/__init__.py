"""Ensembles of runs, the prior of the initial state, the resolution check."""
