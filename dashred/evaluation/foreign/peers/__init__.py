"""Other methods on the same recordings."""
