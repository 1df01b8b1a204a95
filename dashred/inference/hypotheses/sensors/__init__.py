"""Faults of sensors, and starts outside of their prior."""
