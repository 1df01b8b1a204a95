"""Runs, metrics and artifacts in MLflow."""
