"""Benchmark of many twin experiments."""
