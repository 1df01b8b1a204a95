"""Hypotheses about the mismatch, each fitted to the recording."""
