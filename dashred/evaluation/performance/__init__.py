"""How run time and memory grow, and how far they are from what the machine can do."""
