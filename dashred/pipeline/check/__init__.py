"""Checks of a configuration and its recording before an analysis."""
