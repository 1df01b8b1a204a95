"""Recordings, sensors, the observation operator, and the splits into fit and held-out data."""
