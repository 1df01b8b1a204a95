"""A causal filter of a stream of readings, and the charts that watch its innovations."""
