"""The proof: sealed cases are drawn, analysed, opened and scored."""
