"""Paths, atomic writes, and what damaged files raise."""
