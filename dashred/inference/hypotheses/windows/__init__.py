"""Hypotheses with a window: terms that act in a part of space, time or state."""
