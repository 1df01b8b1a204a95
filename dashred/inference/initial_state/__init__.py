"""First guesses of the initial state."""
