"""The schema of the findings files: what `findings.json` and `score.json` hold.

What has not been looked for is null. Errors are RMSEs in units of a standard deviation.
"""

from collections.abc import Mapping
from typing import Any, Literal, NotRequired, TypedDict

Verdict = Literal[
    "missing-term",
    "nothing-missing",
    "parameter",
    "initial-condition",
    "sensor-fault",
    "unresolved-numerics",
    "outside-library",
    "ambiguous",
    "not-converged",
    "mismatch",
    "no-mismatch-seen",
]


class Misfit(TypedDict):
    """RMSE of each method at sensors, in units of each sensor's own standard deviation."""

    before: float | None
    before_refit: float | None
    after: float | None
    simulation: float | None
    shred: float | None
    dashred: float | None


class HeldOut(TypedDict):
    """RMSE on what no fit has seen.

    `heldout_restarted` is the held-out time again, run from a state that was fitted to the last
    samples before it alone. `heldout_episode` is an episode that is held out whole, run from a
    start that was fitted to its beginning; it is there only where one is.
    """

    test_sensors: Misfit
    heldout_time: Misfit
    heldout_restarted: Misfit
    heldout_episode: NotRequired[Misfit]


class Fit(HeldOut):
    """How well the recording is met; `noise_std` is per sensor, in the sensor's own unit.

    `noise_correlation` is between neighbouring samples, of the quantity in which it is largest.
    """

    noise_std: dict[str, float] | None
    noise_correlation: float | None
    chi2: float | None
    unexplained: float | None


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


class Proposal(TypedDict):
    """One term that latent SINDy proposes: coefficient in user's units, rank 1 is the first."""

    equation: str
    term: str
    coefficient: float
    inclusion: float | None
    rank: int


class PathStep(TypedDict):
    """The regression's RMSE when only so many terms are kept."""

    terms: int
    rmse: float


class LatentSindy(TypedDict):
    """What one of the paper's two algorithms proposes."""

    proposals: list[Proposal]
    rmse_path: list[PathStep]


class Latent(TypedDict):
    """Latent SINDy's proposals: Algorithm 1 and Algorithm 2 of the paper."""

    alg1: LatentSindy | None
    alg2: LatentSindy | None


class EpisodeSplit(TypedDict):
    """An episode from `begin` to `end` on its own clock; it was fitted until `time_end`.

    Of one that is held out whole, its start alone.
    """

    name: str
    begin: float
    end: float
    time_end: float
    held_out_whole: bool


class Splits(TypedDict):
    """Names of the sensors in each role, the end of the fit window, and anything to know of it.

    `episodes` is there only where there are several; the window is then that of the longest.
    """

    inputs: list[str]
    extra: list[str]
    validate: list[str]
    test: list[str]
    time_end: float
    note: str | None
    episodes: NotRequired[list[EpisodeSplit]]


class Input(TypedDict):
    """Everything that determines the findings; the snapshots' hash, where there are any."""

    config: dict[str, Any]
    config_sha256: str
    recording_sha256: str
    snapshots_sha256: NotRequired[str]
    seed: int
    versions: dict[str, str]
    library_size: dict[str, int] | None
    splits: Splits | None


class StructureChanged(TypedDict):
    """Which part of a port-Hamiltonian system a term changes; null where it fits into none.

    Of R, what takes energy away, also whether it still does: else the corrected system is none.
    """

    term: str
    part: Literal["H", "J", "R", "G"] | None
    passive: bool | None


class Findings(TypedDict):
    """`findings.json`; what has not been looked for is null.

    `units` are those that the configuration or the recording states, by name, that of time as `t`:
    there where any is.
    """

    verdict: Verdict | None
    causes: list[dict[str, Any]] | None
    where: Where | None
    terms: list[TermFound | ParameterChange] | None
    alternatives: list[Alternative] | None
    smaller: list[SmallerLaw] | None
    energy: EnergyLost | None
    structure: list[StructureChanged] | None
    fit: Fit
    latent: Latent
    corrected: str | None
    input: Input
    units: NotRequired[dict[str, str]]


class Score(TypedDict):
    """`score.json` of a twin; errors of fields are in units of each field's own std.

    The coefficient error is a fraction, known where the support is exact. Forecasts are compared
    over the forecast window, everything else over the fit window. A latent rank is the place of a
    term of the true law among an algorithm's proposals.
    """

    exact_support: bool | None
    coefficient_error: float | None
    region: dict[str, float | None] | None
    cause_right: bool | None
    field_rmse: dict[str, float | None]
    field_rmse_by_field: dict[str, dict[str, float]]
    forecast: dict[str, float | None]
    latent_rank: dict[str, dict[str, int | None]]


def misfit(**known: float) -> Misfit:
    """A misfit with the methods that are known; the others are null.

    Raises:
        TypeError: for a method the schema does not have.
    """
    if unknown := known.keys() - Misfit.__annotations__.keys():
        raise TypeError(f"the findings have no method called {', '.join(sorted(unknown))}")
    return Misfit(
        before=known.get("before"),
        before_refit=known.get("before_refit"),
        after=known.get("after"),
        simulation=known.get("simulation"),
        shred=known.get("shred"),
        dashred=known.get("dashred"),
    )


def new_findings(
    source: Input,
    *,
    fit: Fit | None = None,
    latent: Latent | None = None,
    verdict: Verdict | None = None,
    causes: list[dict[str, Any]] | None = None,
    where: Where | None = None,
    terms: list[TermFound | ParameterChange] | None = None,
    alternatives: list[Alternative] | None = None,
    smaller: list[SmallerLaw] | None = None,
    energy: EnergyLost | None = None,
    structure: list[StructureChanged] | None = None,
    corrected: str | None = None,
    units: Mapping[str, str] | None = None,
) -> Findings:
    """Findings in which everything that was not looked for is null."""
    unfitted = Fit(
        noise_std=None,
        noise_correlation=None,
        chi2=None,
        unexplained=None,
        test_sensors=misfit(),
        heldout_time=misfit(),
        heldout_restarted=misfit(),
    )
    findings = Findings(
        verdict=verdict,
        causes=causes,
        where=where,
        terms=terms,
        alternatives=alternatives,
        smaller=smaller,
        energy=energy,
        structure=structure,
        fit=fit or unfitted,
        latent=latent or Latent(alg1=None, alg2=None),
        corrected=corrected,
        input=source,
    )
    if units:
        findings["units"] = dict(units)
    return findings
