"""Forward models: from start and law to readings, with derivatives."""
