"""MLflow: stores, runs, metrics and artifacts."""
