"""Simulators that are code or snapshots."""
