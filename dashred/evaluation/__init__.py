"""Everything that knows a truth: twin experiments, baselines, benchmarks, the proof."""
