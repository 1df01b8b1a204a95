"""Many twin experiments, and how they went."""
