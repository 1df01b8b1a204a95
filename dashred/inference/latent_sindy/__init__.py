"""Sparse identification of missing terms in the latent space."""
