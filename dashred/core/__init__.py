"""Files, findings, MLflow, errors, units: no physics and no configuration."""
