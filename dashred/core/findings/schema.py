"""The schema of the findings files, `findings.json` and `score.json`.

A quantity that was not determined is null. Errors are RMSEs in units of a standard deviation. The
schemas of a law and of a cause are in :mod:`dashred.core.findings.law_schema` and
:mod:`dashred.core.findings.cause_schema`.
"""

from collections.abc import Mapping, Sequence
from typing import Any, Literal, NotRequired, TypedDict, cast

from dashred.core.findings.cause_schema import Cause, Verdict
from dashred.core.findings.hidden_state_schema import HiddenStateFound
from dashred.core.findings.law_schema import (
    Alternative,
    AlternativeTerm,
    EnergyLoss,
    FittedParameter,
    MissingTerm,
    ParameterChange,
    SmallerLaw,
    StructureChanges,
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
    """RMSE on data that no fit used.

    `heldout_restarted` is the held-out time simulated from a state that was fitted to the last
    samples before it. `heldout_episode` is an episode that was held out completely, simulated from
    an initial state that was fitted to its beginning; the key exists only with such an episode.
    """

    test_sensors: ErrorsByMethod
    heldout_time: ErrorsByMethod
    heldout_restarted: ErrorsByMethod
    heldout_episode: NotRequired[ErrorsByMethod]


HeldOutData = Literal["test_sensors", "heldout_time", "heldout_restarted", "heldout_episode"]


class Comparison(TypedDict):
    """Comparison of `corrected` with `simulation_refit` on one kind of held-out data.

    `before` and `after` are the RMSEs without and with the law, with the sensors corrected for
    both. `difference` is the mean of ``e_after² − e_before²``, and `error` the half width of its
    99 % interval, or null if there are too few samples. `samples` is the number of times. The runs
    of a chaotic system are compared until both are lost: `horizon` is the time from their beginning
    to then. It is null if they are compared to their end. `worse` tells whether the law increases
    the error by more than `error`, or makes a run blow up.
    """

    data: HeldOutData
    before: float
    after: float
    difference: float
    error: float | None
    samples: int
    horizon: float | None
    worse: bool


FaultContradiction = Literal["no-better-than-mean", "other-sensors"]
"""How held-out data contradict that only sensors err.

The simulation predicts no held-out data better than their mean does, or it disagrees with sensors
that no fit has used.
"""

LARGEST_OWN_ERROR = 1e6
"""From this numerical error on, one of the two simulations that are compared is not finite."""


class Fit(HeldOut):
    """Quality of the fit to the recording.

    `noise_std` is the noise of each sensor, in its unit, as stated or estimated from its trace.
    `residual_std` is that of the residuals of the fit. It is much larger if no law explains the
    recording. `chi2` is the misfit of the law per sample, relative to `residual_std`, and
    `unexplained` the share of the squared residuals that is not noise.
    `held_out_samples` are the numbers of times with held-out readings, over all episodes.
    `noise_correlation` is the largest correlation of neighbouring samples over all quantities.
    `own_error` is the numerical error of the simulator at the start of the recording, in units of
    `residual_std`, at most 1e6; null if the law diverges or is not told. If it exceeds 1,
    `sufficient_dt` is a time step with which it is at most 0.1, if there is one, and else null. If
    the simulator is a program, `failure` says how many of its steps failed, and what it said when
    one last did.
    `corrected_dt` is the time step of the corrected simulator if that of the simulator is unstable
    with the law, and else null. `diverges` is the time, in the recording or in the forecast after
    it, at which the corrected simulator leaves all bounds, with shorter time steps as well; null if
    it does not, or if it is a program.
    `comparisons` tell whether held-out data support the law.
    `misfit_at_test_sensors` is the RMSE of the corrected simulator at each test sensor, in
    standard deviations of the residuals at the fitted sensors.
    `faults_contradicted` tells how held-out data contradict that only sensors err. It is null if
    they do not, or if something else was found.
    """

    comparisons: list[Comparison]
    noise_std: dict[str, float] | None
    residual_std: NotRequired[dict[str, float]]
    held_out_samples: NotRequired[dict[HeldOutData, int]]
    noise_correlation: float | None
    own_error: float | None
    failure: NotRequired[str | None]
    sufficient_dt: NotRequired[float | None]
    corrected_dt: NotRequired[float | None]
    diverges: NotRequired[float | None]
    chi2: float | None
    unexplained: float | None
    misfit_at_test_sensors: dict[str, float] | None
    faults_contradicted: NotRequired[FaultContradiction | None]


class Proposal(TypedDict):
    """A term that latent SINDy proposes; coefficient in the user's units, rank from 1."""

    equation: str
    term: str
    coefficient: float
    inclusion: float | None
    rank: int


class PathStep(TypedDict):
    """RMSE of the regression with a given number of terms."""

    terms: int
    rmse: float


class LatentSindy(TypedDict):
    """Proposals of one of the paper's two algorithms."""

    proposals: list[Proposal]
    rmse_path: list[PathStep]


class Latent(TypedDict):
    """Latent SINDy's proposals: Algorithm 1 and Algorithm 2 of the paper.

    `dynamics` holds the proposals of the assimilation with dynamics, if it ran.
    """

    alg1: LatentSindy | None
    alg2: LatentSindy | None
    dynamics: NotRequired[LatentSindy]


class EpisodeSplit(TypedDict):
    """An episode from `begin` to `end` on its own clock; it was fitted until `time_end`.

    If the episode is held out, only its initial state was fitted.
    """

    name: str
    begin: float
    end: float
    time_end: float
    held_out_whole: bool


class Splits(TypedDict):
    """Names of the sensors in each role, the end of the fit window, and a note about the window.

    `episodes` exists only with several episodes; the window is then that of the longest one.
    """

    inputs: list[str]
    extra: list[str]
    validate: list[str]
    test: list[str]
    time_end: float
    note: str | None
    episodes: NotRequired[list[EpisodeSplit]]


class Input(TypedDict):
    """Everything that determines the findings.

    `snapshots_sha256` exists only with snapshots. `library_left_out` has the default terms,
    `equation: term`, that data like the simulation cannot determine, and the reason.
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


class SpentBudget(TypedDict):
    """The budget and the time spent when the findings were made, in seconds, and what was left out.

    `cpu` is the CPU time of the process and of the programs that it has run. If it is far below
    `spent`, the machine was busy with something else.
    """

    seconds: float
    spent: float
    cpu: NotRequired[float]
    not_tried: list[str]


class Findings(TypedDict):
    """`findings.json`; quantities that were not analysed are null.

    `budget` exists only if the time did not suffice for everything: only then do the findings
    depend on the speed of the machine.

    `also_supported` are terms that the recording supports beside the law in `terms`, but that the
    forecast does not need.

    `fitted_parameters` are the parameters that the configuration states with a spread. They are
    fitted beside the law, and the verdict does not depend on their values.

    `hidden_state` exists only if the law contains a state that is not in the equations.

    `units` are the units stated by the configuration or the recording, by name, and the unit of
    time as `t`. The key exists only if a unit is stated.
    """

    verdict: Verdict | None
    causes: list[Cause] | None
    where: Where | None
    terms: list[MissingTerm | ParameterChange] | None
    also_supported: list[AlternativeTerm]
    fitted_parameters: list[FittedParameter]
    hidden_state: NotRequired[HiddenStateFound]
    alternatives: list[Alternative] | None
    smaller: list[SmallerLaw] | None
    energy: EnergyLoss | None
    structure: StructureChanges | None
    fit: Fit
    latent: Latent
    corrected: str | None
    input: Input
    budget: NotRequired[SpentBudget]
    units: NotRequired[dict[str, str]]


class Score(TypedDict):
    """`score.json` of a twin; errors of fields are in units of each field's own std.

    The coefficient error is relative, and known if the support is exact. Forecasts are compared
    over the forecast window, everything else over the fit window. A latent rank is the rank of a
    term of the true law among the proposals of an algorithm.

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
    """Return the errors of the given methods; other errors are null.

    Raises:
        TypeError: a name is not in ``AT_SENSORS``.
    """
    if unknown := rmse.keys() - set(AT_SENSORS):
        raise TypeError(f"the findings have no method called {', '.join(sorted(unknown))}")
    always = [name for name in AT_SENSORS if name in ErrorsByMethod.__required_keys__]
    result = with_deprecated(dict.fromkeys(always) | rmse)
    return cast(ErrorsByMethod, result)


def new_findings(
    source: Input,
    *,
    fit: Fit | None = None,
    latent: Latent | None = None,
    verdict: Verdict | None = None,
    causes: list[Cause] | None = None,
    where: Where | None = None,
    terms: list[MissingTerm | ParameterChange] | None = None,
    also_supported: Sequence[AlternativeTerm] = (),
    fitted_parameters: Sequence[FittedParameter] = (),
    hidden_state: HiddenStateFound | None = None,
    alternatives: list[Alternative] | None = None,
    smaller: list[SmallerLaw] | None = None,
    energy: EnergyLoss | None = None,
    structure: StructureChanges | None = None,
    corrected: str | None = None,
    units: Mapping[str, str] | None = None,
) -> Findings:
    """Return findings in which quantities that are not given are null."""
    unfitted = Fit(
        comparisons=[],
        noise_std=None,
        noise_correlation=None,
        own_error=None,
        chi2=None,
        unexplained=None,
        misfit_at_test_sensors=None,
        test_sensors=errors_by_method(),
        heldout_time=errors_by_method(),
        heldout_restarted=errors_by_method(),
    )
    findings = Findings(
        verdict=verdict,
        causes=causes,
        where=where,
        terms=terms,
        also_supported=list(also_supported),
        fitted_parameters=list(fitted_parameters),
        alternatives=alternatives,
        smaller=smaller,
        energy=energy,
        structure=structure,
        fit=fit or unfitted,
        latent=latent or Latent(alg1=None, alg2=None),
        corrected=corrected,
        input=source,
    )
    if hidden_state is not None:
        findings["hidden_state"] = hidden_state
    if units:
        findings["units"] = dict(units)
    return findings
