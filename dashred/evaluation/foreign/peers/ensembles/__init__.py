"""Ensemble methods for systems of ordinary differential equations."""
