"""A case of the draw, and what its making returns: a recording and the truth."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from typing import Any, Literal

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]
Collection = Literal["dysts", "fields", "mechanics", "published"]
Kind = Literal["term", "source", "region", "sensor", "nothing"]
COLLECTIONS: dict[Collection, str] = {
    "dysts": "polynomial systems of dysts",
    "fields": "fields by py-pde",
    "mechanics": "mechanics by SciPy's Radau with events",
    "published": "problems of other papers",
}
KINDS: dict[Kind, str] = {
    "term": "a term is left out",
    "source": "a localised source",
    "region": "a term in a region",
    "sensor": "a sensor errs",
    "nothing": "nothing is left out",
}


@dataclass(frozen=True)
class Case:
    """One case of the draw.

    Attributes:
        collection: where its system is from.
        system: name of the system in the collection.
        kind: what is hidden.
        number: number of the draw of this system, from 0.
        noise: std of the noise as a share of that of each reading.
        seed: seed of the draw; all random numbers of the case follow from it and from the name.
    """

    collection: Collection
    system: str
    kind: Kind
    number: int
    noise: float
    seed: int

    @property
    def name(self) -> str:
        """Name of the case, and of its files."""
        return f"{self.collection}-{self.system}-{100 * self.noise:g}pc-{self.number}"

    def stream(self, of: str) -> np.random.Generator:
        """Return the random stream of one of its draws; the streams are independent."""
        return np.random.default_rng([self.seed, *self.name.encode(), 0, *of.encode()])

    @property
    def analysis_seed(self) -> int:
        """Seed of the analysis; it contains no information about the case."""
        return int(self.stream("analysis").integers(2**31))


@dataclass(frozen=True)
class TrueTerm:
    """A hidden term in the equation language.

    Attributes:
        equation: the field whose tendency lacks it.
        term: the expression.
        coefficient: of the expression.
        size: number of products when it is multiplied out.
    """

    equation: str
    term: str
    coefficient: float
    size: int = 1


@dataclass(frozen=True)
class LaterStates:
    """States a short time after all times of a recording but the last.

    Attributes:
        interval: the short time.
        states: without noise, on the simulator's grid, ``(time - 1, field, *grid)``.
    """

    interval: float
    states: Array


@dataclass(frozen=True)
class Truth:
    """The truth of a case.

    Attributes:
        kind: what is hidden.
        says: the same as text.
        times: of the recording, ``(time,)``.
        states: without noise, on the simulator's grid, ``(time, field, *grid)``.
        hidden: tendency that the simulator lacks along `states`, of the same shape.
        terms: the hidden law, if the equation language expresses it.
        region: ``(from, to)`` along the first axis; a region across the seam has from > to.
        period: of a source that pulsates.
        sensor: the sensor that errs.
        later: for the methods that are given pairs of states; None where there are none.
    """

    kind: Kind
    says: str
    times: Array
    states: Array
    hidden: Array
    terms: tuple[TrueTerm, ...] = ()
    region: tuple[float, float] | None = None
    period: float | None = None
    sensor: str | None = None
    later: LaterStates | None = None


@dataclass(frozen=True)
class Sensor:
    """One column of the recording.

    Attributes:
        name: of the column.
        field: that it reads.
        position: one coordinate an axis.
    """

    name: str
    field: str
    position: tuple[float, ...] = ()


@dataclass(frozen=True)
class MadeCase:
    """A recording with its simulator and truth.

    Attributes:
        system: section ``system`` of ``case.yaml``.
        library: section ``library``; None for the default.
        sensors: of the recording, one a column.
        readings: with noise, ``(time, sensor)``.
        truth: what the analysis never sees.
    """

    system: Mapping[str, Any]
    library: Mapping[str, Sequence[str]] | None
    sensors: tuple[Sensor, ...]
    readings: Array
    truth: Truth


def start_section(names: Iterable[str], start: Array, spread: Array) -> dict[str, Any]:
    """Return the keys ``start`` and ``spread`` of a system without axes, rounded.

    Args:
        names: of the fields.
        start: the stated start, ``(field,)``.
        spread: its std, ``(field,)``.
    """
    fields = list(names)
    return {
        "start": {n: float(f"{v:.6g}") for n, v in zip(fields, start, strict=True)},
        "spread": {n: float(f"{v:.4g}") for n, v in zip(fields, spread, strict=True)},
    }
