"""Tables with several rows for each time: one for each reading, or for each place."""
