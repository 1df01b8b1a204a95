"""Baseline methods for comparison; not part of an analysis."""
