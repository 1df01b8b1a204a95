"""Cases whose truths are computed by solvers that are not part of dashred."""
