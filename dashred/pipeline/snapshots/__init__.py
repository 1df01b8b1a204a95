"""Runs of a simulator that is known by snapshots alone."""
