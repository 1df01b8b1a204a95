"""The columns of a sensitivity of a spectral system."""
