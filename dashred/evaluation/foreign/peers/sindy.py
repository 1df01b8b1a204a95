"""PySINDy on the full noisy state of an ordinary differential equation.

Both methods seek what the simulator lacks, ``ẋ − N(x) = Σ ξ θ(x)``, in the library of the analysis.
Weak form: Messenger & Bortz, *Weak SINDy* (Multiscale Model. Simul. 19, 2021). Ensemble: Fasel,
Kutz, Brunton & Brunton, *Ensemble-SINDy* (Proc. R. Soc. A 478, 2022).
"""

from __future__ import annotations

import warnings
from collections.abc import Sequence
from functools import partial
from typing import Any

import numpy as np
import torch
from pysindy import (
    STLSQ,
    EnsembleOptimizer,
    PolynomialLibrary,
    SmoothedFiniteDifference,
    WeakPDELibrary,
)

from dashred.evaluation.baselines.estimate import TermEntry
from dashred.evaluation.foreign.cases.case import Array
from dashred.evaluation.foreign.peers.full_state import FullState
from dashred.evaluation.foreign.peers.sparse import sparse_law
from dashred.physics.system import Term
from dashred.physics.terms.library import evaluate_terms

RIDGE = 1e-4
# Test functions of the weak form, and half their width as a share of the record.
TEST_FUNCTIONS, HALF_WIDTH = 200, 0.025
MODELS = 20
# Samples at both ends where the derivative of the smoothed state is one-sided.
ENDS = 5


def weak_sindy(full: FullState) -> list[TermEntry]:
    """Return the law of the weak form."""
    half = HALF_WIDTH * float(full.times[-1] - full.times[0])
    np.random.seed(full.seed % 2**32)  # PySINDy draws the test functions from the global stream
    weak = WeakPDELibrary(
        PolynomialLibrary(degree=1, include_bias=False),
        spatiotemporal_grid=full.times,
        K=TEST_FUNCTIONS,
        H_xt=[half],
    )
    values, known = _columns(full, full.noisy)
    whole = np.concatenate([values, known], axis=1)
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")  # PySINDy labels one axis too many where there is no space
        weak.fit([whole])
        [integrals] = weak.transform([whole])
        rates = np.asarray(weak.convert_u_dot_integral(full.noisy))
    integrals = np.asarray(integrals)
    columns, without = np.split(integrals, [values.shape[1]], axis=1)
    return _law(full, columns, rates - without, lambda threshold: STLSQ(threshold, RIDGE))


def ensemble_sindy(full: FullState) -> list[TermEntry]:
    """Return the law that the median of many regressions has."""
    smooth = SmoothedFiniteDifference()
    rates = np.asarray(smooth._differentiate(full.noisy, full.times))
    states = np.asarray(smooth.smoother(full.noisy, **smooth.smoother_kws))
    values, known = _columns(full, states)
    inner = slice(ENDS, len(full.times) - ENDS)
    optimizer = partial(_ensemble, seed=full.seed)
    return _law(full, values[inner], (rates - known)[inner], optimizer)


def _ensemble(threshold: float, seed: int) -> Any:
    np.random.seed(seed % 2**32)  # PySINDy draws the subsets from the global stream
    return EnsembleOptimizer(STLSQ(threshold, RIDGE), bagging=True, n_models=MODELS)


def _columns(full: FullState, states: Array) -> tuple[Array, Array]:
    """Return the library ``(time, term)`` and the simulator's tendencies ``(time, field)``."""
    known = [Term(name, full.system.equations[name]) for name in full.system.fields]
    both = evaluate_terms(
        full.system, [*full.library, *known], torch.from_numpy(states), torch.from_numpy(full.times)
    )
    columns = both.numpy().T
    return columns[:, : len(full.library)], columns[:, len(full.library) :]


def _law(full: FullState, columns: Array, targets: Array, optimizer: Any) -> list[TermEntry]:
    entries: list[TermEntry] = []
    for i, equation in enumerate(full.system.fields):
        own = [j for j, term in enumerate(full.library) if term.equation == equation]
        if own:
            coefficients = sparse_law(columns[:, own], targets[:, i], optimizer)
            entries += _entries([full.library[j] for j in own], coefficients)
    return entries


def _entries(terms: Sequence[Term], coefficients: Array) -> list[TermEntry]:
    return [
        TermEntry(equation=term.equation, term=str(term), coefficient=float(value))
        for term, value in zip(terms, coefficients, strict=True)
        if value != 0
    ]
