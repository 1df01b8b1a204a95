"""A state observer whose gains come from its own errors on simulations."""
