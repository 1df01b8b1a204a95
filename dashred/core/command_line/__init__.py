"""The ``key=value`` arguments of a command."""
