"""Terms that act in a region, a time span or a range of values."""
