"""Paths, atomic writes and errors of damaged files."""
