"""Find the physics that a simulation leaves out, from sparse sensors (DA-SHRED).

``Problem.from_yaml("rde", recording=dataset).discover()`` returns a ``Result``. Public names are
imported on first use, so that ``import dashred`` takes milliseconds.
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


def _exclude_from_path(folder: str) -> None:
    """Import nothing from the current folder, here or in children, unless it is the checkout.

    `python -m` looks there first, and a folder of recordings may contain another ``yaml.py``.
    """
    if sys.path[:1] == [folder] and not os.path.samefile(folder, f"{__path__[0]}/.."):
        del sys.path[0]
        os.environ["PYTHONSAFEPATH"] = "1"


# `python -m` sets this value while it looks for the module: a command of dashred is being started.
# The hook reports missing packages by name, like other errors.
if sys.argv[:1] == ["-m"]:
    _exclude_from_path(os.getcwd())
    from dashred.core.system_errors import report_uncaught

    sys.excepthook = report_uncaught


def __getattr__(name: str) -> object:
    """Import a public name on first use (PEP 562)."""
    if name == "__version__":
        found: object = _version()
    elif name in _PUBLIC:
        found = getattr(_import_module(name), name)
    else:
        raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
    globals()[name] = found
    return found


def __dir__() -> list[str]:
    return sorted({*globals(), *__all__})


def _import_module(name: str) -> object:
    """Return the module of a public name.

    Raises:
        InputError: the name is part of the evaluation, which this installation does not have.
    """
    from importlib import import_module

    try:
        return import_module(_PUBLIC[name])
    except ModuleNotFoundError as error:
        if not str(error.name).startswith("dashred.evaluation"):
            raise
        from dashred.core.errors import InputError

        what = "this installation of dashred has no twin experiments"
        raise InputError(what, where=name, hint="use a checkout of dashred") from None


def _version() -> str:
    from importlib.metadata import PackageNotFoundError, version

    try:
        return version("dashred")
    except PackageNotFoundError:
        return "0+unknown"
