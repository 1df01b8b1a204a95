"""Schema of the configuration as typed dataclasses."""
