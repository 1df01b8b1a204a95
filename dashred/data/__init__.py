"""Sensors: what they read, recordings of them, and the scales their values are learnt on."""
