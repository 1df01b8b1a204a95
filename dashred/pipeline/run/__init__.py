"""A run: its folder, manifest, checkpoints, provenance."""
