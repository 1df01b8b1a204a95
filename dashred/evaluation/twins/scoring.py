"""How right findings are: the law against the true law, fields against the true fields.

Nothing here opens a seal: the scorer hands over the truth that it read.
"""

from __future__ import annotations

import dataclasses
from collections.abc import Iterable, Mapping, Sequence
from typing import Any, Protocol

import numpy as np
import xarray as xr

from dashred import config as schema
from dashred.evaluation.twins.window_kinds import TrueWindow, WindowKind, kind_found, kind_of
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
)
FORECASTS = ("simulation_same_start", "simulation_refit", "corrected")

Law = dict[tuple[str, Expr, WindowKind | None], float]
"""Coefficient by equation, term, and kind of window, the term in normal form without its number."""


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
        """The number before it."""

    @property
    def window(self) -> TrueWindow | None:
        """``(of, from, to, edge)`` where it acts; None everywhere."""


def score_law(
    findings: Mapping[str, Any],
    truth: Sequence[TrueTerm],
    parameters: Mapping[str, float] | None = None,
) -> tuple[bool | None, float | None]:
    """Return whether the true terms were found and no others, and the worst relative error.

    A parameter's new value counts as the terms that it adds to the simulator's equations: where
    those are not exactly the true ones, the support is not exact. Nor is it for a term that acts
    everywhere and was found in a region only, or the other way round; where a region's edges lie
    is scored by itself. Both are null where no law was looked for; the error is null too where the
    support is not exact.

    Args:
        findings: what was found.
        truth: the true terms.
        parameters: true values of those that the simulator has wrong.
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
    """Return the true law, in the terms of the simulator that the findings hold."""
    system = system_of(findings)
    terms = (
        (t.equation, _expression(system, t.equation, t.term, t.coefficient), kind_of(t.window))
        for t in truth
    )
    return _collect([*terms, *_changes(system, parameters)])


def law_of_findings(findings: Mapping[str, Any]) -> Law:
    """Return the law that was found; empty where none was looked for."""
    return _collect(_found_terms(findings["terms"] or [], system_of(findings)))


def scaled_errors(
    estimates: xr.Dataset, real: np.ndarray, fields: Sequence[str]
) -> dict[str, np.ndarray]:
    """Return each method's error ``(time, field, *grid)``, in units of each true field's std."""
    std = real.swapaxes(0, 1).reshape(len(fields), -1).std(axis=1)
    scale = np.where(std > 0, std, 1.0).reshape(-1, *(1,) * (real.ndim - 2))
    errors = {}
    for method in estimates["method"].values.tolist():
        chosen = estimates.sel({"method": method})
        errors[method] = (np.stack([chosen[f].values for f in fields], axis=1) - real) / scale
    return errors


def rmse(error: np.ndarray) -> float:
    """Root of the mean square over everything."""
    return float(np.sqrt(np.mean(error**2)))


def rmse_by_time(error: np.ndarray) -> np.ndarray:
    """Root mean square at each time, from an error ``(time, field, *grid)``."""
    return np.asarray(np.sqrt(np.mean(error**2, axis=tuple(range(1, error.ndim)))))


def latent_ranks(
    findings: Mapping[str, Any], truth: Sequence[TrueTerm]
) -> dict[str, dict[str, int | None]]:
    """Return where each algorithm of latent SINDy ranked the terms of the true law."""
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
    """Yield what the findings add to each equation."""
    parameters: dict[str, float] = {}
    for entry in entries:
        if entry["equation"] is not None:
            equation = str(entry["equation"])
            text, coefficient = str(entry["term"]), float(entry["coefficient"])
            kind = kind_found(entry.get("region"))
            yield equation, _expression(system, equation, text, coefficient), kind
        elif entry.get("parameter") is not None:
            parameters[str(entry["parameter"])] = float(entry["to"])
    yield from _changes(system, parameters)


def _changes(
    system: System, parameters: Mapping[str, float]
) -> Iterable[tuple[str, Expr, WindowKind | None]]:
    """Yield what other values of parameters add to each equation."""
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
    """Parse a term, its lets and parameters put in, and multiply it with its coefficient."""
    parsed = system.parse(text, "terms", equation=equation)
    return algebra.scale(coefficient, system.resolve(parsed, "terms"))


def system_of(findings: Mapping[str, Any]) -> System:
    """Rebuild the simulator from the configuration that the findings hold."""
    plain = findings["input"]["config"]["system"]
    axes = {name: schema.Axis(**axis) for name, axis in plain["axes"].items()}
    integrator = schema.Integrator(**plain["integrator"])
    built = schema.System(**plain | {"axes": axes, "integrator": integrator})
    return System(built, lambda _: "findings.json")
