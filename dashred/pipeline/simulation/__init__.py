"""Runs of the simulator: nominal, at doubled resolution, and as an ensemble."""
