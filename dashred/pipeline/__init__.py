"""The stages of an analysis: simulation, training, assimilation, discovery and verification."""
