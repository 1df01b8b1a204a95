"""A first configuration for somebody's own recording, guessed from the file."""
