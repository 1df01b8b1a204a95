"""The Python API: the stages of a run without MLflow and without files."""
