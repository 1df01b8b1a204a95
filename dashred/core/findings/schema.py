"""The schema of the findings files, `findings.json` and `score.json`.

A quantity that was not determined is null. The schemas of the fit, of the input, of a law and of a
cause are in :mod:`dashred.core.findings.fit_schema`, :mod:`dashred.core.findings.input_schema`,
:mod:`dashred.core.findings.law_schema` and :mod:`dashred.core.findings.cause_schema`.
"""

from collections.abc import Mapping, Sequence
from typing import NotRequired, TypedDict

from dashred.core.findings.cause_schema import Cause, Verdict
from dashred.core.findings.fit_schema import Fit, errors_by_method
from dashred.core.findings.hidden_state_schema import HiddenStateFound
from dashred.core.findings.input_schema import Input
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
    """Proposals of one of the paper's two algorithms, or of the assimilation with dynamics.

    The latter may also propose changes of parameters, by name.
    """

    proposals: list[Proposal]
    rmse_path: list[PathStep]
    parameters: NotRequired[dict[str, float]]


class Latent(TypedDict):
    """Latent SINDy's proposals: Algorithm 1 and Algorithm 2 of the paper.

    `dynamics` holds the proposals of the assimilation with dynamics, if it ran.
    """

    alg1: LatentSindy | None
    alg2: LatentSindy | None
    dynamics: NotRequired[LatentSindy]


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
