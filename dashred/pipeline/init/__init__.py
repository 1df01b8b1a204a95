"""First configuration for a recording, with values guessed from the file."""
