"""Hypotheses about sensor faults and the initial state."""
