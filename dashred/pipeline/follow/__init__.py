"""Follow a stream of readings with the results of a finished run: ``dashred follow``."""
