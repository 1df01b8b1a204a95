"""Derivatives of spectral trajectories in torch, on the device of the system."""
