"""Methods that fit trajectories to readings: the true form alone, and state and law together."""
