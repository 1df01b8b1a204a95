"""Read and check the input of an analysis, and build its problem."""
