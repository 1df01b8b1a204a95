"""The stages of the search for a law."""
