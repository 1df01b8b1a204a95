"""A state observer: the simulator from sample to sample, and gains from errors on simulations."""
