"""MEDIDA: the law that the simulator lacks, from its errors over one short step.

The simulator advances an ensemble about the first state of each pair ``u(t)``, ``u(t + Δ)`` of the
whole field. Its mean m and covariance B give the analysis of the ensemble Kalman filter,
``a = m + B(B + R)⁻¹(u(t + Δ) − m)``, where R is the covariance of the noise. A relevance vector
machine fits the model errors ``(a − m)/Δ`` of all pairs by the terms ``u^p ∂^q u/∂x^q`` at a.

Source: Mojgani, Chattopadhyay & Hassanzadeh, *Discovery of interpretable structural model errors by
combining Bayesian sparse regression and data assimilation: A chaotic Kuramoto–Sivashinsky test
case* (Chaos 32, 061105, 2022), and its public code, github.com/envfluids/MEDIDA. The interval, the
spread of the ensemble, its members for each point and the threshold of the regression are those of
the code. There the second state has no noise, although R is that of the noise. Differences from the
code: the step and the derivatives are those of the simulator, not of CN-AB2 and finite differences;
there are as many points as the simulator has, not 1,024; and the second state is not perturbed for
each member, which changes nothing on the mean.
"""

from __future__ import annotations

import numpy as np
import torch
from sklearn.linear_model import ARDRegression

from dashred.evaluation.baselines.estimate import TermEntry
from dashred.evaluation.foreign.cases.case import Array
from dashred.evaluation.foreign.peers.full_state import FullState
from dashred.evaluation.foreign.peers.measured import NoAnswerError
from dashred.physics.solvers.simulate import simulate
from dashred.physics.system import System

# Members of the ensemble for each point, and their std about the first state, in the unit of the
# field: that of the paper's equation has a std of about 1.3.
MEMBERS_PER_POINT, SPREAD = 10, 0.25
LARGEST_POWER, HIGHEST_ORDER = 4, 4
# A term is dropped when the precision of its coefficient is larger: below a size of about 0.1.
LARGEST_PRECISION = 100.0
ITERATIONS, CHANGE = 3000, 1e-6
# Members that grow by more within a step blow up.
LARGEST_GROWTH = 1e3


def medida_law(full: FullState, later_noise: float) -> list[TermEntry]:
    """Return the law of the model errors.

    Args:
        full: the states of one field on one axis, and those a short time later.
        later_noise: std of the noise of the later states, as a share of that of the field.

    Raises:
        NoAnswerError: the simulator blows up within a step.
    """
    analyses, errors = model_errors(full, later_noise)
    texts, states = terms_of(full.system), torch.from_numpy(analyses[:, None])
    columns = [full.system.evaluate(text, states).numpy().ravel() for text in texts]
    law = sparse_coefficients(np.stack(columns, axis=1), errors.ravel())
    [equation] = full.system.fields
    return [
        TermEntry(equation=equation, term=text, coefficient=float(value))
        for text, value in zip(texts, law, strict=True)
        if value != 0
    ]


def model_errors(full: FullState, later_noise: float) -> tuple[Array, Array]:
    """Return the analyses of all pairs and the model errors there, ``(pair, point)`` each.

    Arguments and errors as in :func:`medida_law`.
    """
    assert full.later is not None
    rng = np.random.default_rng([full.seed, *b"later"])
    std = float(full.std.item())
    later = full.later.states + later_noise * std * rng.standard_normal(full.later.states.shape)
    one_step = full.system.with_step(full.later.interval)
    pairs = zip(full.times[:-1].tolist(), full.noisy[:-1, 0], later[:, 0], strict=True)
    both = [_analysis(one_step, *pair, full.noise * std, rng) for pair in pairs]
    analyses, errors = zip(*both, strict=True)
    return np.stack(analyses), np.stack(errors)


def terms_of(system: System) -> list[str]:
    """Return the candidate terms as text, for a system of one field on one axis."""
    [field], [axis] = system.fields, system.axes
    powers = [field, *(f"{field}**{p}" for p in range(2, LARGEST_POWER + 1))]
    derivatives = [f"d({field}, {axis.name}, {q})" for q in range(1, HIGHEST_ORDER + 1)]
    return powers + derivatives + [f"{p}*{d}" for d in derivatives for p in powers]


def sparse_coefficients(columns: Array, target: Array) -> Array:
    """Return coefficients of columns ``(row, column)``; those of irrelevant columns are zero.

    A relevance vector machine whose basis functions are the columns is a regression with automatic
    relevance determination.

    Args:
        columns: candidate terms.
        target: ``(row,)``.

    Returns:
        ``(column,)``.
    """
    machine = ARDRegression(
        threshold_lambda=LARGEST_PRECISION,
        max_iter=ITERATIONS,
        tol=CHANGE,
        fit_intercept=False,
    )
    return np.asarray(machine.fit(columns, target).coef_)


def _analysis(
    one_step: System, t: float, first: Array, second: Array, noise: float, rng: np.random.Generator
) -> tuple[Array, Array]:
    """Return the analysis ``(point,)`` at the later time, and the model error there."""
    points, dt = len(first), one_step.dt
    members = first + SPREAD * rng.standard_normal((MEMBERS_PER_POINT * points, points))
    times = torch.tensor([t, t + dt], dtype=torch.float64)
    ran = simulate(one_step, torch.from_numpy(members[:, None]), times)[:, 1, 0].numpy()
    # Written with "<", because the run may end in NaN.
    if not np.abs(ran).max() < LARGEST_GROWTH * np.abs(members).max():
        raise NoAnswerError("the simulator blows up within a step")
    mean, covariance = ran.mean(axis=0), np.cov(ran, rowvar=False)
    innovation = np.linalg.solve(covariance + noise**2 * np.eye(points), second - mean)
    increment = covariance @ innovation
    return mean + increment, increment / dt
