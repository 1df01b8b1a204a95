"""Figures of fields in space and time."""
