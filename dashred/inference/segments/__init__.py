"""Weak-constraint multiple shooting: short segments of the record, with model error between."""
