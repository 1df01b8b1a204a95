"""Selection of laws, sensor errors and forces over segments."""
