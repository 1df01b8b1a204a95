"""Read the twins of a system from ``conf/twins/NAME.yaml``."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

from dashred.config import Config, read_file
from dashred.config.bundled_systems import CONF, check_checkout
from dashred.core.errors import InputError
from dashred.core.findings.fault_kinds import FAULT_KINDS
from dashred.physics.expressions.parser import number

if TYPE_CHECKING:
    from dashred.evaluation.twins.sealing import Concealed, SealedTerm

KEYS = {"terms", "start", "stated", "parameters", "faults", "spread", "correlation"}
FAULTS = tuple(FAULT_KINDS)
STARTS = ("simulator", "own")


@dataclass(frozen=True)
class Twin:
    """A hidden truth. The names of the attributes determine its random stream.

    Attributes:
        name: name of the twin.
        terms: terms that the simulator lacks.
        own_start: whether the initial state is spun up under the true law.
        stated: stated over true standard deviation of the noise.
        concealed: other hidden causes.
    """

    name: str
    terms: tuple[SealedTerm, ...]
    own_start: bool
    stated: float
    concealed: Concealed


def read_entries(config: Config) -> dict[str, Any]:
    """Return all entries of the file by name.

    Raises:
        InputError: the file does not exist or is not a mapping.
    """
    path, label = _place(config)
    if config.source is not None and config.source.parent == CONF:
        check_checkout("the hidden truths of the bundled systems are")
    if not path.is_file():
        raise InputError(
            f"{config.name} has no twins",
            where=str(path),
            hint="analyse a recording of your own with recording.path=FILE",
        )
    return read_file(path, label=label).values


def read_entry(config: Config, name: str) -> dict[str, Any]:
    """Return one entry of the file.

    Raises:
        InputError: the system has no such twin.
    """
    known = read_entries(config)
    entry = known.get(name)
    if not isinstance(entry, dict):
        raise InputError(
            f"{config.name} has no twin {name!r}",
            where=config.where("recording.twin"),
            hint=f"choose from: {', '.join(map(str, known))}",
        )
    return entry


def names_with_simulator_start(config: Config) -> list[str]:
    """Return the names of the twins whose start is that of the simulator."""
    return [
        name
        for name, entry in read_entries(config).items()
        if isinstance(entry, dict) and entry.get("start", STARTS[0]) == STARTS[0]
    ]


def hides_law(entry: dict[str, Any]) -> bool:
    """Return whether a twin has missing terms or other parameter values than the simulator."""
    return bool(entry.get("terms") or entry.get("parameters"))


def hides_nothing(entry: dict[str, Any]) -> bool:
    """Return whether law, sensors and start are as the simulator and the recording state.

    A start spun up under the true law and noise that is misstated or autocorrelated make an
    analysis harder, but are not among its findings.
    """
    return not hides_law(entry) and not entry.get("faults") and entry.get("spread", 1) == 1


def read_twin(config: Config) -> Twin:
    """Read the twin that ``recording.twin`` names.

    Raises:
        InputError: the file or the twin does not exist, or the entry is malformed.
    """
    name, (_, label) = str(config.recording.twin), _place(config)
    return parse_twin(name, read_entry(config, name), label, config)


def parse_twin(name: str, entry: dict[str, Any], label: str, config: Config) -> Twin:
    """Check one entry and return its twin.

    Args:
        name: name of the twin.
        entry: content of the entry.
        label: location of the entry, for error messages.
        config: configuration of the system.

    Raises:
        InputError: the entry is malformed.
    """
    if entry.keys() - KEYS or "terms" not in entry:
        others = ", ".join(sorted(KEYS - {"terms"}))
        raise InputError(f"twin {name!r} must have terms and may have {others}", where=label)
    if not isinstance(entry["terms"], list):
        raise InputError(f"the terms of twin {name!r} must be a list", where=label)
    terms = tuple(_term(item, label, config) for item in entry["terms"])
    start = entry.get("start", STARTS[0])
    if start not in STARTS:
        raise InputError(f"start must be {' or '.join(STARTS)}, not {start!r}", where=label)
    stated = number(str(entry.get("stated", 1.0)), where=label)
    return Twin(name, terms, start == "own", stated, _concealed(entry, label, config))


def _place(config: Config) -> tuple[Path, str]:
    if config.source is None:
        raise InputError(
            f"{config.name} has no twins: it was given as a dict",
            where=config.where(""),
            hint="twins lie beside a configuration file, in the folder twins",
        )
    path = config.source.parent / "twins" / config.source.name
    return path, f"{path.parent.name}/{path.name}"


def _term(item: Any, label: str, config: Config) -> SealedTerm:
    # Imported late: it imports torch, which is not needed to read names.
    from dashred.evaluation.twins.sealing import SealedTerm

    needed = {"equation", "term", "coefficient"}
    if not isinstance(item, dict) or not needed <= item.keys() <= needed | {"window"}:
        raise InputError(
            "a term needs an equation, a term and a coefficient, and may have a window", where=label
        )
    if item["equation"] not in config.system.fields:
        raise InputError(f"{config.name} has no equation {item['equation']!r}", where=label)
    coefficient = number(str(item["coefficient"]), where=label)
    window = _window(item["window"], label, config) if "window" in item else None
    return SealedTerm(str(item["equation"]), str(item["term"]), coefficient, window)


def _concealed(entry: dict[str, Any], label: str, config: Config) -> Concealed:
    """Read the hidden causes other than missing terms."""
    from dashred.evaluation.twins.sealing import Concealed, SealedFault

    parameters = entry.get("parameters", {})
    known = config.system.parameters
    if not isinstance(parameters, dict) or not parameters.keys() <= known.keys():
        raise InputError(
            f"parameters must be true values by name, of {', '.join(known)}", where=label
        )
    faults = []
    for item in entry.get("faults", []):
        complete = isinstance(item, dict) and item.keys() == {"sensor", "kind", "value"}
        if not complete or item["kind"] not in FAULTS:
            raise InputError(
                "a fault needs a sensor, a kind and a value",
                where=label,
                hint=f"kinds: {', '.join(FAULTS)}",
            )
        value = number(str(item["value"]), where=label)
        faults.append(SealedFault(str(item["sensor"]), str(item["kind"]), value))
    correlation = number(str(entry.get("correlation", 0.0)), where=label)
    if not 0 <= correlation < 1:
        raise InputError("correlation must be at least 0 and below 1", where=label)
    return Concealed(
        {name: number(str(value), where=label) for name, value in parameters.items()},
        tuple(faults),
        number(str(entry.get("spread", 1.0)), where=label),
        correlation,
    )


def _window(item: Any, label: str, config: Config) -> tuple[str, float | None, float | None, float]:
    """Read a window: ``{x: [10, 16], edge: 0.4}``, or ``{t: [11, null], edge: 0.3}``."""
    bounded = [key for key in item if key != "edge"] if isinstance(item, dict) else []
    known = {*config.system.axes, *config.system.fields, "t"}
    if len(bounded) != 1 or bounded[0] not in known or "edge" not in item:
        raise InputError(
            "a window needs bounds of one axis, field or t, and an edge",
            where=label,
            hint=f"for example {{x: [10, 16], edge: 0.4}}; names: {', '.join(sorted(known))}",
        )
    [of] = bounded
    ends = item[of]
    is_pair = isinstance(ends, list) and len(ends) == 2
    bounds = [None if e is None else number(str(e), where=label) for e in ends] if is_pair else []
    unbounded = bounds.count(None)
    if not is_pair or unbounded != (0 if of in config.system.axes else 1):
        raise InputError(
            f"the window in {of} needs [from, to]; for a field or t, one of them must be null",
            where=label,
        )
    if of == "t" and bounds[0] is None:
        raise InputError("a window in t needs a start time and must have no end", where=label)
    return of, bounds[0], bounds[1], number(str(item["edge"]), where=label)
