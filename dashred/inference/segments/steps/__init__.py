"""Steps of a simulator over segments, and their derivatives."""
