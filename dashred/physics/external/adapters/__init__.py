"""Kinds of programs: a function in Python, an FMU, a command."""
