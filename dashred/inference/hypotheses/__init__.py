"""Hypotheses about the model error, each fitted to the recording."""
