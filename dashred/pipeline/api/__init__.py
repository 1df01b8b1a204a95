"""The Python API: the stages of an analysis without MLflow and without files."""
