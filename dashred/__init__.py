"""Find the physics that a simulation leaves out, from sparse sensors alone (DA-SHRED)."""

import os
import sys


def _keep_out(folder: str) -> None:
    """Import nothing from the folder that the user is in, here or in a child; unless it is ours.

    `python -m` looks there first: a stranger's recording may lie beside a stranger's ``yaml.py``.
    """
    if sys.path[:1] == [folder] and not os.path.samefile(folder, f"{__path__[0]}/.."):
        del sys.path[0]
        os.environ["PYTHONSAFEPATH"] = "1"


# `python -m` shows itself so while it looks for the module: a command of ours is being started.
# What its imports lack is told by name, as anything else that goes wrong is.
if sys.argv[:1] == ["-m"]:
    _keep_out(os.getcwd())
    from dashred.core.system_errors import report_uncaught

    sys.excepthook = report_uncaught
