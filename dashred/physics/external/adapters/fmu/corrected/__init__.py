"""An FMU of a corrected model: the original FMU, with a law added to its derivatives."""
