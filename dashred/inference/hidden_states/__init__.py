"""Hidden states as explanations."""
