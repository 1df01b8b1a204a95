"""Hypotheses compared by one score."""
