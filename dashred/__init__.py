"""Find the physics that a simulation leaves out, from sparse sensors alone (DA-SHRED).

``Problem.from_yaml("rde", recording=dataset).discover()`` returns a ``Result``. Names are imported
when they are first used: ``import dashred`` alone takes milliseconds.
"""

import os
import sys
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from dashred.core.errors import InputError
    from dashred.evaluation.record import record
    from dashred.pipeline.api.check import Check
    from dashred.pipeline.api.load import load
    from dashred.pipeline.api.plots import Plots
    from dashred.pipeline.api.problem import Problem
    from dashred.pipeline.api.result import Result
    from dashred.pipeline.api.simulator import Simulator

    __version__: str

# The module of each public name.
_PUBLIC = {
    "Check": "dashred.pipeline.api.check",
    "InputError": "dashred.core.errors",
    "Plots": "dashred.pipeline.api.plots",
    "Problem": "dashred.pipeline.api.problem",
    "Result": "dashred.pipeline.api.result",
    "Simulator": "dashred.pipeline.api.simulator",
    "load": "dashred.pipeline.api.load",
    "record": "dashred.evaluation.record",
}
__all__ = [
    "Check",
    "InputError",
    "Plots",
    "Problem",
    "Result",
    "Simulator",
    "__version__",
    "load",
    "record",
]


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


def __getattr__(name: str) -> object:
    """Import a public name when it is first used (PEP 562)."""
    if name == "__version__":
        found: object = _version()
    elif name in _PUBLIC:
        found = getattr(_imported(name), name)
    else:
        raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
    globals()[name] = found
    return found


def __dir__() -> list[str]:
    return sorted({*globals(), *__all__})


def _imported(name: str) -> object:
    """Return the module of a public name.

    Raises:
        InputError: it records a hidden truth, and this installation has none.
    """
    from importlib import import_module

    try:
        return import_module(_PUBLIC[name])
    except ModuleNotFoundError as error:
        if not str(error.name).startswith("dashred.evaluation"):
            raise
        from dashred.core.errors import InputError

        what = "this installation of dashred has no hidden truths to record"
        raise InputError(what, where=name, hint="it takes a checkout of dashred") from None


def _version() -> str:
    from importlib.metadata import PackageNotFoundError, version

    try:
        return version("dashred")
    except PackageNotFoundError:
        return "0+unknown"
