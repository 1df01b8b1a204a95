"""The functions of the FMI standard, from the headers of FMPy."""

from __future__ import annotations

import re
from dataclasses import dataclass
from pathlib import Path

# Functions that a corrected FMU has of its own.
OWN = {
    2: ("SetupExperiment", "Reset", "SetTime", "GetReal", "GetDerivatives"),
    3: (
        "EnterInitializationMode",
        "Reset",
        "SetTime",
        "GetFloat64",
        "GetContinuousStateDerivatives",
    ),
}
# Functions whose answers would not know the law, or that would lose the time.
REFUSED = {
    2: (
        "GetFMUstate",
        "SetFMUstate",
        "FreeFMUstate",
        "SerializedFMUstateSize",
        "SerializeFMUstate",
        "DeSerializeFMUstate",
        "GetDirectionalDerivative",
        "SetRealInputDerivatives",
        "GetRealOutputDerivatives",
    ),
    3: (
        "GetFMUState",
        "SetFMUState",
        "FreeFMUState",
        "SerializedFMUStateSize",
        "SerializeFMUState",
        "DeserializeFMUState",
        "GetDirectionalDerivative",
        "GetAdjointDerivative",
        "GetOutputDerivatives",
    ),
}


@dataclass(frozen=True)
class FmiFunction:
    """A function of the standard that returns a status.

    Attributes:
        name: without the prefix ``fmi2`` or ``fmi3``.
        parameters: in C.
        arguments: the same values in a call of the original's function.
    """

    name: str
    parameters: str
    arguments: str


def headers() -> Path:
    """Return the folder of the headers."""
    import fmpy

    return Path(fmpy.__file__).parent / "c-code"


def read_functions(version: int) -> list[FmiFunction]:
    """Return the functions of ``FMI version`` that return a status."""
    text = (headers() / f"fmi{version}FunctionTypes.h").read_text(encoding="utf-8")
    pattern = rf"typedef\s+fmi{version}Status\s+fmi{version}(\w+)TYPE\s*\(([^)]*)\)"
    return [
        _function(name, parameters.split(",")) for name, parameters in re.findall(pattern, text)
    ]


def _function(name: str, parameters: list[str]) -> FmiFunction:
    # The first parameter is the instance. Some have no name: "fmi2Byte[]".
    written, arguments = ["void *c"], ["((Model *)c)->own"]
    for index, parameter in enumerate(map(str.strip, parameters[1:]), 1):
        whole = parameter.removesuffix("[]").rstrip()
        found = re.fullmatch(r"(.*[\s*])\w+", whole, re.DOTALL)
        brackets = "[]" if parameter.endswith("[]") else ""
        written.append(f"{found[1] if found else f'{whole} '}p{index}{brackets}")
        arguments.append(f"p{index}")
    return FmiFunction(name, " ".join(", ".join(written).split()), ", ".join(arguments))
