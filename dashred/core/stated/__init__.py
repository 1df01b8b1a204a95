"""Parsing of what a configuration states of a recording, shared by its checks and its readers."""
