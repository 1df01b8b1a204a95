"""Compare findings with the truth of a case."""
