"""Bundled systems whose equations are hidden behind functions."""
