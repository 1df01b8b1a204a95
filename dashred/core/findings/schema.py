"""The schema of the findings files, `findings.json` and `score.json`.

A quantity that was not determined is null. Errors are RMSEs in units of a standard deviation. The
schemas of a law and of a cause are in files of their own.
"""

from collections.abc import Mapping
from typing import Any, NotRequired, TypedDict, cast

from dashred.core.findings.cause_schema import Cause, Verdict
from dashred.core.findings.law_schema import (
    Alternative,
    EnergyLost,
    ParameterChange,
    SmallerLaw,
    StructureFound,
    TermFound,
    Where,
)
from dashred.core.findings.methods import AT_SENSORS, with_deprecated


class ErrorsByMethod(TypedDict):
    """RMSE of each method at sensors, in units of each sensor's standard deviation.

    The names are those of :mod:`dashred.core.findings.methods`. `nearest_snapshots` and
    `shred_plain` exist only for a simulator that is given as snapshots.

    `before`, `before_refit`, `after` and `snapshots` are deprecated: they repeat
    `simulation_same_start`, `simulation_refit`, `corrected` and `nearest_snapshots` for one
    release.
    """

    simulation: float | None
    simulation_same_start: float | None
    simulation_refit: float | None
    shred: float | None
    dashred: float | None
    corrected: float | None
    nearest_snapshots: NotRequired[float]
    shred_plain: NotRequired[float]
    before: float | None
    before_refit: float | None
    after: float | None
    snapshots: NotRequired[float]


class HeldOut(TypedDict):
    """RMSE on what no fit has seen.

    `heldout_restarted` is the held-out time again, run from a state that was fitted to the last
    samples before it alone. `heldout_episode` is an episode that is held out whole, run from a
    start that was fitted to its beginning; it is there only where one is.
    """

    test_sensors: ErrorsByMethod
    heldout_time: ErrorsByMethod
    heldout_restarted: ErrorsByMethod
    heldout_episode: NotRequired[ErrorsByMethod]


class Fit(HeldOut):
    """How well the recording is met; `noise_std` is per sensor, in the sensor's own unit.

    `noise_correlation` is between neighbouring samples, of the quantity in which it is largest;
    `own_error` is the simulator's, where the recording begins, in standard deviations of the noise.
    """

    noise_std: dict[str, float] | None
    noise_correlation: float | None
    own_error: float | None
    chi2: float | None
    unexplained: float | None


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
    """Everything that determines the findings; the snapshots' hash, where there are any.

    `library_left_out` has the default terms, `equation: term`, of which data like the simulation
    would tell nothing, and why.
    """

    config: dict[str, Any]
    config_sha256: str
    recording_sha256: str
    snapshots_sha256: NotRequired[str]
    seed: int
    versions: dict[str, str]
    library_size: dict[str, int] | None
    library_left_out: NotRequired[dict[str, str]]
    splits: Splits | None


class Findings(TypedDict):
    """`findings.json`; what has not been looked for is null.

    `units` are those that the configuration or the recording states, by name, that of time as `t`:
    there where any is.
    """

    verdict: Verdict | None
    causes: list[Cause] | None
    where: Where | None
    terms: list[TermFound | ParameterChange] | None
    alternatives: list[Alternative] | None
    smaller: list[SmallerLaw] | None
    energy: EnergyLost | None
    structure: StructureFound | None
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

    `before`, `before_refit` and `after` in `forecast` are deprecated: they repeat
    `simulation_same_start`, `simulation_refit` and `corrected` for one release.
    """

    exact_support: bool | None
    coefficient_error: float | None
    region: dict[str, float | None] | None
    cause_right: bool | None
    field_rmse: dict[str, float | None]
    field_rmse_by_field: dict[str, dict[str, float]]
    forecast: dict[str, float | None]
    latent_rank: dict[str, dict[str, int | None]]


def errors_by_method(**rmse: float) -> ErrorsByMethod:
    """Return the errors of the given methods; the others are null.

    Raises:
        TypeError: a name is not that of a method compared at sensors.
    """
    if unknown := rmse.keys() - set(AT_SENSORS):
        raise TypeError(f"the findings have no method called {', '.join(sorted(unknown))}")
    always = [name for name in AT_SENSORS if name in ErrorsByMethod.__required_keys__]
    found = with_deprecated(dict.fromkeys(always) | rmse)
    return cast(ErrorsByMethod, found)


def new_findings(
    source: Input,
    *,
    fit: Fit | None = None,
    latent: Latent | None = None,
    verdict: Verdict | None = None,
    causes: list[Cause] | None = None,
    where: Where | None = None,
    terms: list[TermFound | ParameterChange] | None = None,
    alternatives: list[Alternative] | None = None,
    smaller: list[SmallerLaw] | None = None,
    energy: EnergyLost | None = None,
    structure: StructureFound | None = None,
    corrected: str | None = None,
    units: Mapping[str, str] | None = None,
) -> Findings:
    """Findings in which everything that was not looked for is null."""
    unfitted = Fit(
        noise_std=None,
        noise_correlation=None,
        own_error=None,
        chi2=None,
        unexplained=None,
        test_sensors=errors_by_method(),
        heldout_time=errors_by_method(),
        heldout_restarted=errors_by_method(),
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
