"""Files, findings, MLflow, errors and units; independent of physics and configuration."""
