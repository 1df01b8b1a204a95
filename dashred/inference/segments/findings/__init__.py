"""Findings of a search over segments."""
