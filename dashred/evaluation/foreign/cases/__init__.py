"""Draw and make the cases: what is hidden, the recording, and the truth."""
