"""Terms and faults in words."""
