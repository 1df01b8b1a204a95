"""Estimators for real time, beside an ensemble filter on the true law."""
