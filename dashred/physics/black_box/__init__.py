"""Simulators given as Python code or as snapshots."""
