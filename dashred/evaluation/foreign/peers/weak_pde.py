"""PDE-FIND in weak form on the full noisy field of one dimension, by PySINDy.

Derivatives act on the test functions: none is taken of the noisy field. What the simulator knows is
subtracted term by term, so that the regression seeks the rest alone. Source: Reinbold, Gurevich &
Grigoriev, *Using noisy or incomplete data to discover models of spatiotemporal dynamics* (Phys.
Rev. E 101, 2020).
"""

from __future__ import annotations

import re
import warnings

import numpy as np
from pysindy import STLSQ, PolynomialLibrary, WeakPDELibrary

from dashred.evaluation.baselines.estimate import TermEntry
from dashred.evaluation.foreign.cases.case import Array
from dashred.evaluation.foreign.peers.full_state import FullState
from dashred.evaluation.foreign.peers.sparse import sparse_law
from dashred.physics.expressions import algebra
from dashred.physics.expressions.algebra import Expr
from dashred.physics.system import System

RIDGE = 1e-4
DEGREE, ORDER = 3, 4
# Test functions, their half widths as shares of the axis and of the record, and their power.
TEST_FUNCTIONS, WIDTHS, POWER = 300, (1 / 8, 1 / 10), 6


class NotExpressibleError(Exception):
    """The simulator has a term that is not a feature of the library."""


def weak_pde(full: FullState) -> list[TermEntry]:
    """Return the law of the weak form.

    Raises:
        NotExpressibleError: the simulator's terms are not in the library of PySINDy.
    """
    system, [axis] = full.system, full.system.axes
    fields = list(system.fields)
    places = np.arange(axis.points) * axis.length / axis.points
    grid = np.stack(np.meshgrid(places, full.times, indexing="ij"), axis=-1)
    values = full.noisy.transpose(2, 0, 1)
    spans = (axis.length, full.times[-1] - full.times[0])
    np.random.seed(full.seed % 2**32)  # PySINDy draws the test functions from the global stream
    weak = WeakPDELibrary(
        PolynomialLibrary(degree=DEGREE, include_bias=False),
        derivative_order=ORDER,
        spatiotemporal_grid=grid,
        include_bias=True,
        K=TEST_FUNCTIONS,
        H_xt=[share * span for share, span in zip(WIDTHS, spans, strict=True)],
        p=POWER,
    )
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")  # PySINDy warns about the order of its axes
        weak.fit([values])
        [features] = weak.transform([values])
        rates = np.asarray(weak.convert_u_dot_integral(values))
    names = weak.get_feature_names(fields)
    columns, texts = np.asarray(features), [text_of(name, fields, axis.name) for name in names]
    entries = []
    for i, field in enumerate(fields):
        target = rates[:, i] - columns @ _known(system, field, texts)
        law = sparse_law(columns, target, lambda threshold: STLSQ(threshold, RIDGE))
        entries += [
            TermEntry(equation=field, term=text, coefficient=float(value))
            for text, value in zip(texts, law, strict=True)
            if value != 0
        ]
    return entries


def text_of(feature: str, fields: list[str], axis: str) -> str:
    """Return a feature of PySINDy in the equation language: ``u^2u_11`` is u²∂²u/∂x²."""
    match = re.fullmatch(rf"(.*?)(?:({'|'.join(fields)})_(1+))?", feature)
    assert match is not None
    function, field, order = match.groups()
    factors = [function.replace(" ", "*").replace("^", "**")] if function else []
    if field:
        factors.append(f"d({field}, {axis}, {len(order)})")
    return "*".join(factors)


def _known(system: System, field: str, texts: list[str]) -> Array:
    """Return the coefficients of the simulator's equation in the features."""
    index: dict[Expr, tuple[int, float]] = {}
    for j, text in enumerate(texts):
        laplacian = re.sub(r"d\((\w+), \w+, 2\)", r"lap(\1)", text)
        laplacian = re.sub(r"d\((\w+), \w+, 4\)", r"lap(lap(\1))", laplacian)
        for each in (text, laplacian):
            factor, expression = algebra.split_coefficient(
                system.resolve(system.parse(each, "feature", equation=field), "feature")
            )
            index[expression] = j, factor
    known = np.zeros(len(texts))
    for summand in algebra.summands(system.resolved[field]):
        coefficient, expression = algebra.split_coefficient(summand)
        if coefficient == 0.0:
            continue
        if expression not in index:
            raise NotExpressibleError(f"{algebra.to_text(expression)} is not a feature of PySINDy")
        j, factor = index[expression]
        known[j] += coefficient / factor
    return known
