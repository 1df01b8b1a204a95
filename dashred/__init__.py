"""Find the physics that a simulation leaves out, from sparse sensors alone (DA-SHRED)."""

import sys

# `python -m` shows itself so while it looks for the module: a command of ours is being started.
# What its imports lack is told by name, as anything else that goes wrong is.
if sys.argv[:1] == ["-m"]:
    from dashred.machine_failures import tell_uncaught

    sys.excepthook = tell_uncaught
