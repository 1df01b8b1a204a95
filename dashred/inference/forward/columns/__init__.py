"""Columns of Jacobians, on this machine or on a cluster."""
