"""The findings of a run, as data and as a checked JSON document."""
