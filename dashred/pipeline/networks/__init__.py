"""Train SHRED, and assimilate the recording."""
