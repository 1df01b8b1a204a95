"""The times of samples: as they are, on a uniform clock, and the time scale of the traces."""
