"""Bookkeeping of a run: folder, manifest, checkpoints and provenance."""
