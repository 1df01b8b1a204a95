"""Tables of text and DataFrames: their header, their columns and their times."""
