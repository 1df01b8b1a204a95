"""The library of a corrected FMU: its source code, and its compilation."""

from __future__ import annotations

import shutil
import subprocess
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from dashred.core.templates import render
from dashred.physics.expressions.algebra import Expr, Number, names, substitute
from dashred.physics.expressions.c_code import DEFINITIONS, c_code
from dashred.physics.external.adapters.fmu.corrected.functions import (
    OWN,
    REFUSED,
    headers,
    read_functions,
)
from dashred.physics.external.adapters.fmu.description import (
    CO_SIMULATION,
    REALS,
    SETTABLE,
    Description,
)

TEMPLATES = "physics/external/adapters/fmu/corrected/templates"
SECONDS = 60.0
LAST_LINES = 5


class NotPossibleError(Exception):
    """There is no FMU of this corrected model; the message says why, as a clause."""


@dataclass(frozen=True)
class Correction:
    """What is added to an FMU.

    Attributes:
        law: what is added to the derivative of each field: functions of fields, parameters, inputs
            and ``t``.
        parameters: values by name.
        step: longest step of the splitting, for co-simulation.
    """

    law: Mapping[str, Expr]
    parameters: Mapping[str, float]
    step: float


def write_source(
    description: Description, correction: Correction, tokens: tuple[str, str], library: str
) -> str:
    """Return the source code in C.

    Args:
        description: of the original FMU.
        correction: what is added to it.
        tokens: GUIDs, or instantiation tokens, of the corrected and the original FMU.
        library: file name of the original library, in the folder of the new one.

    Raises:
        NotPossibleError: the law reads an input that is no real variable of the FMU, or the FMU
            cannot be initialised in another state.
    """
    version = 2 if description.is_second else 3
    is_stepped = description.kind == CO_SIMULATION
    fields = _fields_in_order(description, list(correction.law))
    variables = dict(zip(correction.law, description.fields, strict=True))
    read = _read_names(description, correction, fields)
    places = {name: f"u[{i}]" for i, name in enumerate(read)} | {"t": "t"}
    others = {**description.others, **variables}
    numbers: dict[str, Expr] = {
        name: Number(value) for name, value in correction.parameters.items() if name not in read
    }
    law = [c_code(substitute(correction.law[field], numbers), places) for field in fields]
    functions = read_functions(version)
    own = OWN[version] + (("DoStep",) if is_stepped else ())
    refused = set(REFUSED[version]) | (set() if is_stepped else {"DoStep"})
    return render(
        f"{TEMPLATES}/corrected.c.j2",
        folder=TEMPLATES,
        version=version,
        token=_c_string(tokens[0]),
        original_token=_c_string(tokens[1]),
        original_library=_c_string(library),
        definitions=DEFINITIONS,
        known=[others[name].valueReference for name in read],
        slopes=[each.variable.valueReference for each in description.description.derivatives],
        law=law,
        parameters=[_start_value(*each, version) for each in starts(description, correction)],
        is_co_simulation=is_stepped,
        refused=[f for f in functions if f.name in refused],
        forwarded=[f for f in functions if f.name not in refused and f.name not in own],
        **(_initialisation(description, fields, variables, correction.step) if is_stepped else {}),
    )


def starts(description: Description, correction: Correction) -> list[tuple[Any, float]]:
    """Return the variables of the FMU that are parameters, and their values."""
    return [
        (variable, correction.parameters[name])
        for name, variable in description.others.items()
        if name in correction.parameters
    ]


def compile_library(source: Path, library: Path) -> None:
    """Compile the source code.

    Raises:
        NotPossibleError: there is no compiler, or it fails.
    """
    compiler = shutil.which("cc") or shutil.which("gcc")
    if compiler is None:
        raise NotPossibleError("there is no C compiler (cc or gcc)")
    words = [compiler, "-shared", "-fPIC", "-O2", "-w", f"-I{headers()}", "-o", library, source]
    try:
        ended = subprocess.run(
            [*map(str, words), "-ldl", "-lm"], capture_output=True, timeout=SECONDS, check=False
        )
    except (OSError, subprocess.TimeoutExpired) as error:
        raise NotPossibleError(f"the C compiler does not run: {error}") from None
    if ended.returncode:
        said = ended.stderr.decode("utf-8", "replace").splitlines()[:LAST_LINES]
        raise NotPossibleError(f"the C compiler fails: {' / '.join(said)}")


def _fields_in_order(description: Description, fields: Sequence[str]) -> list[str]:
    """Return the fields in the order of the FMU's states."""
    if not description.order:
        return list(fields)
    by_state = dict(zip(description.order, fields, strict=True))
    return [by_state[index] for index in sorted(by_state)]


def _read_names(
    description: Description, correction: Correction, fields: Sequence[str]
) -> list[str]:
    """Return the names whose values the law reads from the FMU; the fields are first."""
    read = sorted(frozenset().union(*map(names, correction.law.values())) - {*fields, "t"})
    known = [
        name
        for name in read
        if name in description.others and description.others[name].type in REALS
    ]
    for name in read:
        if name not in known and name not in correction.parameters:
            raise NotPossibleError(f"the law reads {name}, which is not a real variable of the FMU")
    return [*fields, *known]


def _initialisation(
    description: Description,
    fields: Sequence[str],
    variables: Mapping[str, Any],
    step: float,
) -> dict[str, Any]:
    """Return what a new initialisation must be given, by the names in the template."""
    if not description.is_second:
        raise NotPossibleError("for co-simulation this is possible with FMI 2 only")
    states = {variable.valueReference for variable in variables.values()}
    found: dict[str, list[int]] = {
        name: [] for name in ("approximate", "exact", "integers", "booleans")
    }
    kinds = {"Integer": "integers", "Enumeration": "integers", "Boolean": "booleans"}
    for variable in description.description.modelVariables:
        is_set = variable.causality == "input" or variable.initial in SETTABLE
        reference = variable.valueReference
        if not is_set or variable.variability == "constant":
            continue
        if variable.type == "String":
            what = f"its text {variable.name} would be lost when it is initialised at each step"
            raise NotPossibleError(what)
        real = "approximate" if variable.initial == "approx" else "exact"
        kind = found[kinds.get(variable.type, real)]
        if (variable.type in kinds or reference not in states) and reference not in kind:
            kind.append(reference)
    exact = [int(variables[field].initial != "approx") for field in fields]
    return {**found, "states_exact": exact, "step": repr(step)}


def _start_value(variable: Any, value: float, version: int) -> dict[str, Any]:
    integer = "Integer" if version == 2 else "Int64"
    kind = integer if variable.type == "Enumeration" else variable.type
    is_real = kind in ("Real", "Float64", "Float32")
    code = repr(float(value)) if is_real else repr(int(value))
    return {"type": kind, "reference": variable.valueReference, "value": code}


def _c_string(text: str) -> str:
    """Return a literal of C, in which all but letters and digits are octal."""
    plain = (chr(c) if chr(c).isalnum() and c < 128 else f"\\{c:03o}" for c in text.encode())
    return f'"{"".join(plain)}"'
