"""Comparison of all methods with the hidden truth of many twins; not part of an analysis."""
