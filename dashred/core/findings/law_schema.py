"""The schema of what the findings say of a law: its terms, its rivals, where it acts, what it does.

What has not been looked for is null.
"""

from typing import Any, Literal, NotRequired, TypedDict


class TermFound(TypedDict):
    """A missing term: coefficient, its std and 95 % interval in the user's units.

    `inclusion` is the posterior probability that the term belongs to the law. `unit` is that of the
    coefficient, there where it follows from stated units.
    """

    equation: str
    term: str
    coefficient: float
    std: float
    ci95: list[float]
    inclusion: float
    region: list[dict[str, Any]] | None
    says: str
    unit: NotRequired[str]


# `from` is a keyword of Python, so this one cannot be written as a class.
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
        "region": list[dict[str, Any]] | None,
        "says": str,
        "unit": NotRequired[str],
    },
)
"""A mis-stated parameter: `coefficient` is to - from, `ci95` that of the new value, and `aliases`
are other parameters a change of which does the same; `unit` is there where it is stated."""


class TermTried(TypedDict):
    """A term of an alternative law; of a parameter the equation is null.

    `region` says where it acts; null everywhere.
    """

    equation: str | None
    term: str
    coefficient: float
    region: str | None


class Alternative(TypedDict):
    """Another law; `rival` if the recording does not decide between it and the best one.

    `same_as_best`: the sensors read the same under both, so no recording of them would decide.
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
    """What would have to be added where and when, in units of each equation's own tendency.

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


class Where(TypedDict):
    """Where the law acts: in which equation, when, in what part of state space, at what sensors.

    `forcing` is the map of a free forcing, where the best law left a question; else null.
    """

    equation: dict[str, float]
    region: list[dict[str, Any]] | None
    time: list[float]
    regime: str | None
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
    """Which part of a port-Hamiltonian system a term changes; null where it fits into none alone.

    Of R, what takes energy away, also whether the term by itself does.
    """

    term: str
    part: Literal["H", "J", "R", "G"] | None
    passive: bool | None


class StructureFound(TypedDict):
    """What a law does to a port-Hamiltonian system, and whether all of it together stays one."""

    changes: list[StructureChanged]
    port_hamiltonian: bool
