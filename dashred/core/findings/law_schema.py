"""The schema of a law in the findings: its terms, alternatives, location and consequences.

A quantity that was not determined is null. The texts `says`, `region` of :class:`TermTried` and
`regime` render the other keys for a reader. They are added when the findings are assembled, and no
code reads a number from them.
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
``field, below`` in the values of a field. `std` is that of each edge, `ci95` of the threshold."""


class TermFound(TypedDict):
    """A missing term: coefficient, its std and 95 % interval in the user's units.

    `inclusion` is the posterior probability that the term belongs to the law. `unit` is that of the
    coefficient, where it follows from stated units. `effect` names what the term does.
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
        "says": NotRequired[str],
    },
)
"""A parameter with a wrong value: `coefficient` is ``to - from``, `ci95` that of the new value.
`aliases` are other parameters a change of which has the same effect. The change is `exact`, or of
first order. `unit` is the stated one, if any."""


class TermTried(TypedDict):
    """A term of an alternative law; of a parameter the equation is null.

    `window` is where the term acts, and `region` the same as text; both are null everywhere.
    """

    equation: str | None
    term: str
    coefficient: float
    window: Region | None
    region: NotRequired[str | None]


class Alternative(TypedDict):
    """Another law; `rival` if the recording does not distinguish it from the best one.

    `same_as_best`: the sensors read the same under both, so no recording can distinguish them.
    """

    terms: list[TermTried]
    delta_bic: float
    rival: bool
    same_as_best: bool


class SmallerLaw(TypedDict):
    """The best law of fewer terms, and the share of what the best law explains that it explains."""

    terms: list[TermTried]
    explained: float


class SensorGain(TypedDict):
    """Mean squared residual in units of the noise, without the law and with it, and p of that."""

    name: str
    before: float | None
    after: float | None
    gain: float | None
    p: float | None


class Profile(TypedDict):
    """RMS residual over all sensors in units of the noise, without the law and with it."""

    times: list[float]
    before: list[float | None]
    after: list[float | None]


class Forcing(TypedDict):
    """The forcing that the simulation lacks, by place and time, in units of each own tendency.

    `places` holds the middle of each cell along every axis; amplitudes and their standard
    deviations are, by equation, lists of cells of lists of knots; `peak` is where they are largest;
    `gain` is the evidence for them.
    """

    places: list[list[float]]
    times: list[float]
    amplitude: dict[str, list[list[float]]]
    std: dict[str, list[list[float]]]
    peak: list[float]
    gain: float


class ActiveStates(TypedDict, total=False):
    """The states that carry most of a law's power: those on one side of a threshold.

    The threshold `above` or `below` is that of `field`, or of its `magnitude`, to `precision`. The
    `share` of all points lies there, and carries the share `carried` of the power.
    """

    field: Required[str]
    magnitude: Required[bool]
    above: float
    below: float
    precision: Required[float]
    share: Required[float]
    carried: Required[float]


class Where(TypedDict):
    """Where the law acts: in which equation, when, in what part of state space, at what sensors.

    `states` is null where the law acts in all states; `regime` is the same as text. `forcing` is
    the map of a free forcing, if one was needed; else null.
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


class Share(TypedDict):
    """The share of its energy that a cycle loses, negative for a gain, and its std."""

    lost: float
    std: float


class EnergyLost(TypedDict):
    """What the corrected system loses in its first and its last whole cycle of the fit window."""

    expression: str
    cycles: int
    first: Share
    last: Share


class StructureChanged(TypedDict):
    """Which part of a port-Hamiltonian system a term changes; null where it is no single part.

    `passive`: of a change of R, the dissipation, whether the term by itself dissipates energy.
    """

    term: str
    part: Literal["H", "J", "R", "G"] | None
    passive: bool | None


class StructureFound(TypedDict):
    """What a law changes in a port-Hamiltonian system, and whether the corrected one is such."""

    changes: list[StructureChanged]
    port_hamiltonian: bool
