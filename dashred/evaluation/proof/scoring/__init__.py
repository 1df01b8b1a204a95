"""Scores of the cases and the targets of the proof."""
