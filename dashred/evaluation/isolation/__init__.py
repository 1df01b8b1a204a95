"""Analyse recordings in processes that cannot access a truth, here or on a cluster."""
