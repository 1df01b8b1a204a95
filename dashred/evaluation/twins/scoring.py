"""Scores of findings: the law against the true law, the fields against the true fields.

This module does not open a seal: the scorer passes the truth to it.
"""

from __future__ import annotations

import dataclasses
from collections.abc import Iterable, Mapping, Sequence
from typing import Any, Protocol

import numpy as np
import xarray as xr
from omegaconf import OmegaConf

from dashred import config as schema
from dashred.evaluation.twins.window_kinds import TrueWindow, WindowKind, region_kind, window_kind
from dashred.physics.expressions import algebra
from dashred.physics.expressions.algebra import Expr, Number
from dashred.physics.system import System

METHODS = (
    "simulation",
    "simulation_same_start",
    "simulation_refit",
    "shred",
    "dashred",
    "corrected",
    "corrected_shred",
    "observer",
)
FORECASTS = ("simulation_same_start", "simulation_refit", "corrected")

Law = dict[tuple[str, Expr, WindowKind | None], float]
"""Coefficient by equation, term and kind of window; the term is normalised, without its number."""


class TrueTerm(Protocol):
    """One term of the true law, in the equation language."""

    @property
    def equation(self) -> str:
        """The field whose tendency it adds to."""

    @property
    def term(self) -> str:
        """The expression."""

    @property
    def coefficient(self) -> float:
        """The coefficient of the term."""

    @property
    def window(self) -> TrueWindow | None:
        """``(of, from, to, edge)`` where the term acts; None if it acts everywhere."""


def score_law(
    findings: Mapping[str, Any],
    truth: Sequence[TrueTerm],
    parameters: Mapping[str, float] | None = None,
) -> tuple[bool | None, float | None]:
    """Return whether the support is exact, and the largest relative error of the coefficients.

    A new value of a parameter counts as the terms that it adds to the simulator's equations. The
    support is not exact if a term that acts everywhere was found in a region only, or the other way
    round; the edges of a region are scored separately. Both values are None if no law was sought;
    the error is None if the support is not exact.

    Args:
        findings: content of ``findings.json``.
        truth: the true terms.
        parameters: true values of the misstated parameters.
    """
    if findings.get("terms") is None:
        return None, None
    true, found = law_of_truth(findings, truth, parameters or {}), law_of_findings(findings)
    if found.keys() != true.keys():
        return False, None
    return True, max((abs(found[key] / true[key] - 1) for key in true), default=0.0)


def law_of_truth(
    findings: Mapping[str, Any], truth: Sequence[TrueTerm], parameters: Mapping[str, float]
) -> Law:
    """Return the true law, expressed in the simulator that the findings contain."""
    system = system_of(findings)
    terms = (
        (t.equation, _expression(system, t.equation, t.term, t.coefficient), window_kind(t.window))
        for t in truth
    )
    return _collect([*terms, *_parameter_changes(system, parameters)])


def law_of_findings(findings: Mapping[str, Any]) -> Law:
    """Return the law that was found; empty if none was sought."""
    return _collect(_found_terms(findings["terms"] or [], system_of(findings)))


def scaled_errors(
    estimates: xr.Dataset, real: np.ndarray, fields: Sequence[str]
) -> dict[str, np.ndarray]:
    """Return the errors by method, ``(time, field, *grid)``, in std of each true field."""
    scale = field_scale(real)
    errors = {}
    for method in estimates["method"].values.tolist():
        chosen = estimates.sel({"method": method})
        errors[method] = (np.stack([chosen[f].values for f in fields], axis=1) - real) / scale
    return errors


def field_scale(real: np.ndarray) -> np.ndarray:
    """Return the std of each field of ``(time, field, *grid)``; 1 where it is zero."""
    std = real.swapaxes(0, 1).reshape(real.shape[1], -1).std(axis=1)
    return np.where(std > 0, std, 1.0).reshape(-1, *(1,) * (real.ndim - 2))


def rmse(error: np.ndarray) -> float:
    """Return the root mean square of all values."""
    return float(np.sqrt(np.mean(error**2)))


def rmse_by_time(error: np.ndarray) -> np.ndarray:
    """Return the root mean square at each time, ``(time,)``, of ``(time, field, *grid)``."""
    return np.asarray(np.sqrt(np.mean(error**2, axis=tuple(range(1, error.ndim)))))


def latent_ranks(
    findings: Mapping[str, Any], truth: Sequence[TrueTerm]
) -> dict[str, dict[str, int | None]]:
    """Return the rank of each true term by algorithm of latent SINDy; None if not proposed."""
    ranks: dict[str, dict[str, int | None]] = {}
    for name, latent in findings["latent"].items():
        if latent is not None:
            found = {(p["equation"], p["term"]): p["rank"] for p in latent["proposals"]}
            ranks[name] = {
                f"{t.equation}: {t.term}": found.get((t.equation, t.term)) for t in truth
            }
    return ranks


def _found_terms(
    entries: Sequence[Mapping[str, Any]], system: System
) -> Iterable[tuple[str, Expr, WindowKind | None]]:
    """Yield the expressions that the findings add to each equation."""
    parameters: dict[str, float] = {}
    for entry in entries:
        if entry["equation"] is not None:
            equation = str(entry["equation"])
            text, coefficient = str(entry["term"]), float(entry["coefficient"])
            kind = region_kind(entry.get("region"))
            yield equation, _expression(system, equation, text, coefficient), kind
        elif entry.get("parameter") is not None:
            parameters[str(entry["parameter"])] = float(entry["to"])
    yield from _parameter_changes(system, parameters)


def _parameter_changes(
    system: System, parameters: Mapping[str, float]
) -> Iterable[tuple[str, Expr, WindowKind | None]]:
    """Yield the expressions that new parameter values add to each equation."""
    if not parameters:
        return
    values = system.config.parameters | dict(parameters)
    changed = system.with_config(dataclasses.replace(system.config, parameters=values))
    for equation, before in system.resolved.items():
        yield equation, changed.resolved[equation], None
        yield equation, algebra.multiply((Number(-1.0), before)), None


def _collect(added: Iterable[tuple[str, Expr, WindowKind | None]]) -> Law:
    law: Law = {}
    for equation, expression, kind in added:
        for summand in algebra.summands(expression):
            coefficient, term = algebra.split_coefficient(summand)
            law[equation, term, kind] = law.get((equation, term, kind), 0.0) + coefficient
    return {key: coefficient for key, coefficient in law.items() if coefficient != 0.0}


def _expression(system: System, equation: str, text: str, coefficient: float) -> Expr:
    """Parse a term, substitute lets and parameters, and multiply it by its coefficient."""
    parsed = system.parse(text, "terms", equation=equation)
    return algebra.scale(coefficient, system.resolve(parsed, "terms"))


def system_of(findings: Mapping[str, Any]) -> System:
    """Rebuild the simulator from the configuration in the findings."""
    plain = findings["input"]["config"]["system"]
    sections = OmegaConf.merge(OmegaConf.structured(schema.System), plain)
    built = OmegaConf.to_object(sections)
    assert isinstance(built, schema.System)
    return System(built, lambda _: "findings.json")
