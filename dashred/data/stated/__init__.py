"""What the configuration states of sensors, parameters and inputs, applied to the recording."""
