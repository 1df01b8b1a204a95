"""Comparison of hypotheses by one score."""
