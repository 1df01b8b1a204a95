"""Scores of the concealed cases, and the targets they are held to."""
