"""Held-out errors, and checks of the corrected simulator."""
