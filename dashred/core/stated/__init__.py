"""Parsing of what a configuration states, shared by its checks and its readers."""
