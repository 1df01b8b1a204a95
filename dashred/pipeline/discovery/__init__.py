"""The stages of the discovery of a law."""
