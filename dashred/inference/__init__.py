"""Find the missing terms: latent SINDy (Algorithms 1 and 2 of the paper)."""
