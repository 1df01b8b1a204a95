"""What an FMU says of itself: its kind, states and variables."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any
from xml.etree import ElementTree
from zipfile import ZipFile

from dashred.core.errors import InputError, nearest

MODEL_EXCHANGE, CO_SIMULATION = "ModelExchange", "CoSimulation"
# Names of the two kinds in a configuration.
INTERFACES = {"model-exchange": MODEL_EXCHANGE, "co-simulation": CO_SIMULATION}
# Values of `initial` of variables that may be set at the start.
SETTABLE = ("exact", "approx")
REALS = ("Real", "Float64")
DIRECTIONAL = "providesDirectionalDerivative"


@dataclass(frozen=True)
class Description:
    """An FMU and its variables under the names of a system.

    Attributes:
        path: of the FMU.
        description: as FMPy has read it.
        kind: ``ModelExchange`` or ``CoSimulation``.
        fields: variables of the fields, in their order.
        order: index in its continuous states of each field; of no use for co-simulation.
        others: variables of parameters and inputs, by name.
    """

    path: Path
    description: Any
    kind: str
    fields: tuple[Any, ...]
    order: tuple[int, ...]
    others: Mapping[str, Any]

    @property
    def is_second(self) -> bool:
        """Whether it has FMI 2, else FMI 3."""
        return str(self.description.fmiVersion).startswith("2")

    @property
    def offers_derivatives(self) -> bool:
        """Whether it says that it has directional derivatives; FMPy reads this of FMI 2 only."""
        with ZipFile(self.path) as archive:
            root = ElementTree.fromstring(archive.read("modelDescription.xml"))
        own = root.find(self.kind)
        name = DIRECTIONAL + ("" if self.is_second else "s")
        return own is not None and own.get(name) in ("true", "1")


def read_description(
    path: str,
    fields: Sequence[str],
    others: Iterable[str],
    variables: Mapping[str, str],
    interface: str | None,
    place: str,
    optional: Iterable[str] = (),
) -> Description:
    """Read the description of an FMU and find its variables.

    Args:
        path: of the FMU.
        fields: of the system, in their order.
        others: parameters and inputs that the FMU has.
        variables: names of variables that differ from those of the system.
        interface: ``model-exchange`` or ``co-simulation``; None takes the first one if the FMU has
            both, because its states can be set at any time.
        place: location of its key.
        optional: further parameters and inputs, which the FMU may have.

    Raises:
        InputError: it is no FMU, is for another platform or another version, lacks a variable, or
            has states that are not fields.
    """
    try:
        import fmpy
    except ImportError:
        what, hint = "an FMU needs the package fmpy", "pip install 'dashred[fmu]'"
        raise InputError(what, where=place, hint=hint) from None
    try:
        description = fmpy.read_model_description(path, validate=False)
        platforms = fmpy.supported_platforms(path)
    except FileNotFoundError:
        raise InputError("there is no such file", where=path) from None
    except Exception as error:  # a damaged archive or description raises many kinds of errors
        reason = str(error).splitlines()[0] if str(error) else type(error).__name__
        raise InputError(f"not a readable FMU: {reason}", where=path) from None
    name = Path(path).name
    version = str(description.fmiVersion)
    if version[:1] not in ("2", "3"):
        raise InputError(f"{name} has FMI {version}, but 2 or 3 is needed", where=place)
    if fmpy.platform not in platforms:
        others = ", ".join(found for found in platforms if found != "c-code")
        has = f"has binaries for {others}, not" if others else "has no binaries"
        what = f"{name} {has} for {fmpy.platform}"
        raise InputError(what, where=place, hint="export it for this platform")
    offered = {
        "model-exchange": description.modelExchange,
        "co-simulation": description.coSimulation,
    }
    kinds = [own for own, offer in offered.items() if offer is not None]
    if not kinds or interface not in (None, *kinds):
        told = " and ".join(kinds) or "neither model exchange nor co-simulation"
        raise InputError(f"{name} offers {told}, not {interface or 'these'}", where=place)
    kind = INTERFACES[interface or kinds[0]]
    known = {variable.name: variable for variable in description.modelVariables}

    def variable_of(own: str) -> Any:
        theirs = variables.get(own, own)
        if theirs not in known:
            what = f"{name} has no variable {theirs}"
            hint = f"{nearest(theirs, known)} (system.simulator.variables: {{{own}: NAME}})"
            raise InputError(what, where=place, hint=hint)
        return known[theirs]

    found = tuple(variable_of(field) for field in fields)
    for field, variable in zip(fields, found, strict=True):
        if variable.type not in REALS or variable.dimensions:
            kind_of = "an array" if variable.dimensions else variable.type
            what = f"{name}: {variable.name} is {kind_of}, but the field {field} is a real number"
            raise InputError(what, where=place)
        if kind == CO_SIMULATION and variable.initial not in SETTABLE:
            what = f"{name}: {variable.name} cannot be set: its initial value is {variable.initial}"
            raise InputError(what, where=place, hint="choose variables with initial exact")
    order = _order_of_states(description, found, kind, name, place)
    given = {each: variable_of(each) for each in others}
    given |= {each: known[each] for each in optional if each in known and _is_given(known[each])}
    return Description(Path(path), description, kind, found, order, given)


def _is_given(variable: Any) -> bool:
    """Whether a variable gets its value from outside."""
    return variable.causality in ("parameter", "input")


def _order_of_states(
    description: Any, fields: Sequence[Any], kind: str, name: str, place: str
) -> tuple[int, ...]:
    """Return the index of each field in the continuous states; the fields must be all of them.

    An FMU for co-simulation need not tell its states: then the fields count as all of them.
    """
    states = [unknown.variable.derivative for unknown in description.derivatives]
    if not states and kind == CO_SIMULATION:
        return ()
    if not states:
        raise InputError(f"{name} has no continuous states that can be stepped", where=place)
    # Variables with one reference are one quantity under several names.
    own = [variable.valueReference for variable in fields]
    theirs = [state.valueReference for state in states]
    for state in states:
        if state.dimensions:
            what = f"{name} has an array as a state, {state.name}; only numbers are read"
            raise InputError(what, where=place)
        if state.valueReference not in own:
            what = f"{name} has the state {state.name}, which is not a field"
            hint = f"add a field; with system.simulator.variables: {{FIELD: {state.name}}}"
            raise InputError(what, where=place, hint=hint)
    for variable in fields:
        if variable.valueReference not in theirs:
            names = ", ".join(state.name for state in states)
            what = f"{name}: {variable.name} is not a state"
            raise InputError(what, where=place, hint=f"its states: {names}")
    return tuple(theirs.index(reference) for reference in own)
