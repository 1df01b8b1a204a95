"""The schema of a law in the findings: its terms, alternatives, location and consequences.

A quantity that was not determined is null. The texts `says`, `regime` and `region` of
:class:`AlternativeTerm` describe the other keys. They are added when the findings are assembled,
and no code parses them.
"""

from typing import Literal, NotRequired, Required, TypedDict

# `from` is a keyword of Python, so the schemas with that key cannot be written as classes.
Region = TypedDict(
    "Region",
    {
        "axis": str,
        "field": str,
        "from": float,
        "to": float,
        "above": float,
        "below": float,
        "std": float,
        "ci95": list[float],
    },
    total=False,
)
"""Where a term acts: ``axis, from, to`` in space, ``axis: t, from`` in time, ``field, above`` or
``field, below`` in the values of a field. `std` is that of each edge, `ci95` that of the threshold.

`from` and `to` are coordinates of the axis, between 0 and its length. If `from` is larger than
`to`, the region crosses the end of a periodic axis: it is above `from` and below `to`.
"""


class MissingTerm(TypedDict):
    """A missing term: coefficient, its standard deviation and 95 % interval in the user's units.

    `inclusion` is the posterior probability that the term belongs to the law. `unit` is the unit of
    the coefficient, if it follows from stated units. `effect` names the physical effect.
    """

    equation: str
    term: str
    coefficient: float
    std: float
    ci95: list[float]
    inclusion: float
    region: list[Region] | None
    unit: NotRequired[str]
    effect: NotRequired[str]
    says: NotRequired[str]


ParameterChange = TypedDict(
    "ParameterChange",
    {
        "equation": None,
        "parameter": str,
        "term": str,
        "from": float,
        "to": float,
        "coefficient": float,
        "std": float,
        "ci95": list[float],
        "aliases": list[str],
        "inclusion": float,
        "region": list[Region] | None,
        "exact": bool,
        "unit": NotRequired[str],
        "meaning": NotRequired[str],
        "says": NotRequired[str],
    },
)
"""A parameter with a wrong value: `coefficient` is ``to - from``, `ci95` that of the new value.
`aliases` are other parameters whose change has the same effect. The change is `exact`, or else of
first order. `unit` is the stated unit, if any. `meaning` is what the offset of a boundary condition
is added to, such as ``value of T at the left end``."""


class FittedParameter(TypedDict):
    """A parameter that the configuration states with a spread. It is no part of the law.

    `stated` and `spread` are its prior: mean and standard deviation. `value` is the fitted value,
    `std` its standard deviation, and `ci95` its 95 % interval. `aliases` are other parameters whose
    change has the same effect. The value is `exact`, or else correct to first order. `unit` is the
    stated unit, if any. A fitted gain or offset of a sensor has the name of the `sensor`, a
    fitted delay that of the `input`, and a parameter with a value per episode that of the
    `episode`.
    """

    parameter: str
    stated: float
    spread: float
    value: float
    std: float
    ci95: list[float]
    aliases: list[str]
    exact: bool
    unit: NotRequired[str]
    sensor: NotRequired[str]
    episode: NotRequired[str]
    input: NotRequired[str]


class AlternativeTerm(TypedDict):
    """A term of an alternative law; the equation of a parameter is null.

    `window` is where the term acts, and `region` is the same as text. Both are null for a term that
    acts everywhere.
    """

    equation: str | None
    term: str
    coefficient: float
    window: Region | None
    region: NotRequired[str | None]


class Alternative(TypedDict):
    """An alternative law; `rival` if the recording does not distinguish it from the best law.

    `same_as_best`: the sensors read the same under both laws, so no recording distinguishes them.
    """

    terms: list[AlternativeTerm]
    delta_bic: float
    rival: bool
    same_as_best: bool


class SmallerLaw(TypedDict):
    """The best law with fewer terms, and how much it explains as a share of the best law."""

    terms: list[AlternativeTerm]
    explained: float


class SensorGain(TypedDict):
    """Mean squared residual without and with the law, in units of `fit.noise_std`, and p."""

    name: str
    before: float | None
    after: float | None
    gain: float | None
    p: float | None


class Profile(TypedDict):
    """RMS residual over all sensors in units of `fit.noise_std`, without and with the law."""

    times: list[float]
    before: list[float | None]
    after: list[float | None]


class Forcing(TypedDict):
    """The forcing that the simulation lacks, in units of the tendency of each equation.

    `places` holds the centre of each cell along every axis. `amplitude` and `std` are, by equation,
    lists of cells of lists of knots. `peak` is the place and time of the largest amplitude, and
    `gain` the evidence for the forcing.
    """

    places: list[list[float]]
    times: list[float]
    amplitude: dict[str, list[list[float]]]
    std: dict[str, list[list[float]]]
    peak: list[float]
    gain: float


SourceRegion = TypedDict("SourceRegion", {"axis": str, "from": float, "to": float})
"""Where a source acts along an axis; `from` exceeds `to` if it wraps around the axis."""


class LocalisedSource(TypedDict):
    """A source at one place, in the equation of a field.

    `place` is its peak, one coordinate for each axis. `region` holds 95 % of a normal distribution
    with its width. `strength` is its integral over the domain, averaged over the record, in the
    unit of the equation times that of the axes. `share` is the share of the misfit beyond noise
    that it explains. `rates` is its integral over the domain at the `times`. `period` and `begin`
    are null if it is not periodic, or if it acts from the start. `as_terms`: the terms of the law
    express the source.
    """

    equation: str
    place: list[float]
    place_std: list[float]
    region: list[SourceRegion]
    period: float | None
    period_std: float | None
    begin: float | None
    begin_std: float | None
    strength: float
    strength_std: float
    share: float
    times: list[float]
    rates: list[float]
    as_terms: bool


class ActiveStates(TypedDict, total=False):
    """The states with most of a law's power: those on one side of a threshold.

    `above` or `below` is the threshold of `field`, or of its `magnitude`, known to `precision`.
    `share` is the fraction of points in these states, and `carried` their fraction of the power.
    """

    field: Required[str]
    magnitude: Required[bool]
    above: float
    below: float
    precision: Required[float]
    share: Required[float]
    carried: Required[float]


class Where(TypedDict):
    """Where the law acts: in which equations, at which times, in which states, at which sensors.

    `states` is null if the law acts in all states; `regime` is the same as text. `forcing` is the
    map of a free forcing, or null if none was needed. `source` is a localised source, or null.
    """

    equation: dict[str, float]
    region: list[Region] | None
    time: list[float]
    states: ActiveStates | None
    regime: NotRequired[str | None]
    sensors: list[SensorGain]
    significance: float | None
    profile: Profile
    forcing: Forcing | None
    source: LocalisedSource | None


class Share(TypedDict):
    """The fraction of energy lost in a cycle, negative for a gain, and its standard deviation."""

    lost: float
    std: float


class EnergyLoss(TypedDict):
    """Energy loss of the corrected system in the first and last full cycle of the fit window."""

    expression: str
    cycles: int
    first: Share
    last: Share


class PartChange(TypedDict):
    """The part of a port-Hamiltonian system that a term changes; null if it is not a single part.

    `passive` is for a change of R, the dissipation: whether the term alone dissipates energy.
    """

    term: str
    part: Literal["H", "J", "R", "G"] | None
    passive: bool | None


class StructureChanges(TypedDict):
    """Changes of a port-Hamiltonian system, and whether the result is port-Hamiltonian."""

    changes: list[PartChange]
    port_hamiltonian: bool
