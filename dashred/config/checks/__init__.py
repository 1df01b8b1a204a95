"""Checks of a configuration that its types cannot express."""
