"""Other methods on the same recordings, for comparison: none of them is part of an analysis."""
