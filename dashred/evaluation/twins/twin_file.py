"""The file of a system's hidden truths, ``conf/twins/NAME.yaml``: for the recorder; and names."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

from dashred.config import Config, read_file
from dashred.config.bundled_systems import CONF, check_checkout
from dashred.core.errors import InputError
from dashred.physics.expressions.parser import number

if TYPE_CHECKING:
    from dashred.evaluation.twins.sealing import Concealed, SealedTerm

KEYS = {"terms", "start", "stated", "parameters", "faults", "spread", "correlation"}
FAULTS = ("bias", "drift", "stuck", "spikes", "misplaced")
STARTS = ("simulator", "own")


@dataclass(frozen=True)
class Twin:
    """One hidden truth: the law, how it is spun up, and how honestly its noise is stated."""

    name: str
    terms: tuple[SealedTerm, ...]
    own_start: bool
    stated: float
    concealed: Concealed


def entries(config: Config) -> dict[str, Any]:
    """Return every twin of the system by name, as it is written in the file.

    Raises:
        InputError: there is no such file, or it is no mapping.
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


def entry_of(config: Config, name: str) -> dict[str, Any]:
    """Return one twin as it is written in the file.

    Raises:
        InputError: the system has no such twin.
    """
    known = entries(config)
    entry = known.get(name)
    if not isinstance(entry, dict):
        raise InputError(
            f"{config.name} has no twin {name!r}",
            where=config.where("recording.twin"),
            hint=f"choose from: {', '.join(map(str, known))}",
        )
    return entry


def basic(config: Config) -> list[str]:
    """Return the names of the twins that start from the simulator's own start."""
    return [
        name
        for name, entry in entries(config).items()
        if isinstance(entry, dict) and entry.get("start", STARTS[0]) == STARTS[0]
    ]


def hides_law(entry: dict[str, Any]) -> bool:
    """Return whether a truth obeys another law than the simulator: terms, or parameters' values."""
    return bool(entry.get("terms") or entry.get("parameters"))


def hides_nothing(entry: dict[str, Any]) -> bool:
    """Return whether law, sensors and start are what the simulator and the recording say.

    A start that was spun up under the truth's own law, and a noise that is stated wrongly or
    correlated, are hardships of an analysis, and no findings of it.
    """
    return not hides_law(entry) and not entry.get("faults") and entry.get("spread", 1) == 1


def read_twin(config: Config) -> Twin:
    """Read the twin that ``recording.twin`` names.

    Raises:
        InputError: no such file or twin, or the entry is not well formed.
    """
    name, (_, label) = str(config.recording.twin), _place(config)
    return twin_of(name, entry_of(config, name), label, config)


def twin_of(name: str, entry: dict[str, Any], label: str, config: Config) -> Twin:
    """Check one entry, and return the twin that it describes.

    Args:
        name: of the twin.
        entry: as it would be written in the file.
        label: where it stands, for messages.
        config: of the system.

    Raises:
        InputError: the entry is not well formed.
    """
    if entry.keys() - KEYS or "terms" not in entry:
        others = ", ".join(sorted(KEYS - {"terms"}))
        raise InputError(f"twin {name!r} must have terms, and may have {others}", where=label)
    if not isinstance(entry["terms"], list):
        raise InputError(f"the terms of twin {name!r} must be a list", where=label)
    terms = tuple(_term(item, label, config) for item in entry["terms"])
    start = entry.get("start", STARTS[0])
    if start not in STARTS:
        raise InputError(f"a start is {' or '.join(STARTS)}, not {start!r}", where=label)
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
    # Imported late: it brings torch, which names alone can be read without.
    from dashred.evaluation.twins.sealing import SealedTerm

    needed = {"equation", "term", "coefficient"}
    if not isinstance(item, dict) or not needed <= item.keys() <= needed | {"window"}:
        raise InputError(
            "a term has an equation, a term and a coefficient, and may have a window", where=label
        )
    if item["equation"] not in config.system.fields:
        raise InputError(f"{config.name} has no equation {item['equation']!r}", where=label)
    coefficient = number(str(item["coefficient"]), where=label)
    window = _window(item["window"], label, config) if "window" in item else None
    return SealedTerm(str(item["equation"]), str(item["term"]), coefficient, window)


def _concealed(entry: dict[str, Any], label: str, config: Config) -> Concealed:
    """Read what else than a law is otherwise than the simulation has it."""
    from dashred.evaluation.twins.sealing import Concealed, SealedFault

    parameters = entry.get("parameters", {})
    known = config.system.parameters
    if not isinstance(parameters, dict) or not parameters.keys() <= known.keys():
        raise InputError(f"parameters are true values by name, of {', '.join(known)}", where=label)
    faults = []
    for item in entry.get("faults", []):
        whole = isinstance(item, dict) and item.keys() == {"sensor", "kind", "value"}
        if not whole or item["kind"] not in FAULTS:
            raise InputError(
                "a fault has a sensor, a kind and a value",
                where=label,
                hint=f"kinds: {', '.join(FAULTS)}",
            )
        value = number(str(item["value"]), where=label)
        faults.append(SealedFault(str(item["sensor"]), str(item["kind"]), value))
    correlation = number(str(entry.get("correlation", 0.0)), where=label)
    if not 0 <= correlation < 1:
        raise InputError("a correlation lies between 0 and 1", where=label)
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
            "a window bounds one axis, field or t, and has an edge",
            where=label,
            hint=f"as in {{x: [10, 16], edge: 0.4}}; one of: {', '.join(sorted(known))}",
        )
    [of] = bounded
    ends = item[of]
    whole = isinstance(ends, list) and len(ends) == 2
    bounds = [None if e is None else number(str(e), where=label) for e in ends] if whole else []
    unbounded = bounds.count(None)
    if not whole or unbounded != (0 if of in config.system.axes else 1):
        raise InputError(
            f"the window in {of} needs [from, to]; of a field or t one of them is null", where=label
        )
    if of == "t" and bounds[0] is None:
        raise InputError("a window in t begins at a time and has no end", where=label)
    return of, bounds[0], bounds[1], number(str(item["edge"]), where=label)
