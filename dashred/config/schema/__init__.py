"""The configuration as typed dataclasses."""
