"""Ensembles of simulations, the prior of the initial state, and the resolution check."""
