"""All methods held against the hidden truth of many twins; nothing of it is part of an analysis."""
