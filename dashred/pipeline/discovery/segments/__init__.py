"""Stages of the search for laws over segments of the recording."""
