"""Every Butcher tableau: its order conditions, and its steps against torchdiffeq's."""

from __future__ import annotations

import math
from pathlib import Path

import numpy as np
import pytest
import torch
from torchdiffeq import odeint

from dashred.physics.methods import METHODS
from dashred.physics.runge_kutta import CLASSICAL, advance
from dashred.physics.runs.initial_state_prior import nominal_start
from dashred.physics.solvers.compiled_simulator import InterpretedSystem, compile_system
from dashred.physics.solvers.schedule import round_up, schedule
from dashred.physics.solvers.simulate import simulate

ROOT = Path(__file__).parents[2]
BY_NAME = {name: t for kind in METHODS.values() for name, t in kind.items() if t is not None}
TABLEAUX = {**BY_NAME, "classical": CLASSICAL}
FIXED = [name for name, tableau in METHODS["ode"].items() if tableau is not None]
every = pytest.mark.parametrize("tableau", TABLEAUX.values(), ids=TABLEAUX)
OSCILLATOR = """
    fields: {x: place, p: momentum}
    equations: {x: p, p: -2*sin(x) - 0.1*p + 0.2*cos(3*t)}
    start: {x: 1, p: 0.3}
"""


def residuals(tableau):
    """Return how far each order condition is missed, by order (Hairer, Nørsett & Wanner, II.2)."""
    stages = len(tableau.b)
    a, b, c = np.zeros((stages, stages)), np.array(tableau.b), np.array(tableau.c)
    for row, shares in zip(a, tableau.a, strict=True):
        row[: len(shares)] = shares
    return {
        1: [b.sum() - 1],
        2: [b @ c - 1 / 2],
        3: [b @ c**2 - 1 / 3, b @ a @ c - 1 / 6],
        4: [
            b @ c**3 - 1 / 4,
            (b * c) @ a @ c - 1 / 8,
            b @ a @ c**2 - 1 / 12,
            b @ a @ a @ c - 1 / 24,
        ],
    }


@every
def test_a_tableau_meets_the_conditions_of_its_order_and_no_more(tableau):
    missed = {n: max(map(abs, found)) for n, found in residuals(tableau).items()}
    assert all(missed[n] < 1e-15 for n in range(1, tableau.order + 1))
    assert tableau.order == 4 or missed[tableau.order + 1] > 1e-3


@every
def test_a_tableau_is_explicit_and_its_nodes_are_the_sums_of_its_rows(tableau):
    assert [len(row) for row in tableau.a] == list(range(len(tableau.b)))
    assert tableau.c == pytest.approx([sum(row) for row in tableau.a], abs=1e-15)


@every
def test_a_step_converges_with_its_order(tableau):
    """``u' = cos(t) u`` from 1: ``u = exp(sin(t))``; the clock of each stage matters."""
    errors = []
    for steps in (40, 80):
        h, u = 2.0 / steps, 1.0
        for i in range(steps):
            u = advance(tableau, lambda u, t: math.cos(t) * u, u, i * h, h)
        errors.append(abs(u - math.exp(math.sin(2.0))))
    assert math.log2(errors[0] / errors[1]) == pytest.approx(tableau.order, abs=0.15)


@pytest.mark.parametrize("method", FIXED)
def test_steps_are_those_of_torchdiffeq(method):
    def rate(u, t):
        return torch.sin(u.flip(-1)) * math.cos(t)

    start = torch.tensor([[1.0, 0.3], [0.2, -2.0]], dtype=torch.float64)
    times = torch.linspace(0.0, 1.0, 21, dtype=torch.float64)
    expected = odeint(lambda t, u: rate(u, t.item()), start, times, method=method)[-1]
    found = start
    for begin, end in zip(times[:-1].tolist(), times[1:].tolist(), strict=True):
        found = advance(BY_NAME[method], rate, found, begin, end - begin)
    torch.testing.assert_close(found, expected, rtol=1e-13, atol=1e-14)


@pytest.mark.parametrize("method", FIXED)
def test_compiled_steps_are_those_that_are_interpreted(make_system, method):
    system = make_system(f"{OSCILLATOR}    integrator: {{method: {method}, dt: 0.03}}")
    start, times = nominal_start(system), torch.tensor([0.0, 0.1, 0.37, 1.0]).double()
    run, plain = compile_system(system, ()), simulate(system, start, times)
    assert not isinstance(run, InterpretedSystem)
    found = run(start, times, torch.zeros((1, 0)).double())
    torch.testing.assert_close(found, plain, rtol=1e-12, atol=1e-13)


def test_the_reference_names_every_method():
    row = next(
        line
        for line in (ROOT / "docs" / "config.md").read_text(encoding="utf-8").splitlines()
        if line.startswith("| `system.integrator.method`")
    )
    assert all(f"`{name}`" in row for kind in METHODS.values() for name in kind)


def test_steps_end_at_every_output_time_and_are_no_longer_than_asked():
    times = [0.0, 0.1, 0.37, 1.0, 1.01, 2.5, 4.0]
    steps = list(schedule(times, 0.07))
    ends = [step.t + step.h for step in steps if step.ends]
    assert ends == pytest.approx(times[1:], rel=1e-11)
    assert [step.t for step in steps if step.begins] == times[:-1]
    assert 0 < min(step.h for step in steps) <= max(step.h for step in steps) <= 0.07 + 1e-9


@pytest.mark.parametrize(
    ("ratio", "count"), [(15.0000001, 15), (14.9999, 15), (15.1, 16), (0.2, 1)]
)
def test_rounding_does_not_add_a_step(ratio, count):
    assert round_up(ratio) == count
