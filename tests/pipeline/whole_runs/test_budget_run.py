"""A run ends in its time: with an honest verdict, or with one clear message."""

from __future__ import annotations

import math
import time
from typing import Any

import numpy as np
import pandas as pd
import pytest

import dashred
from dashred.physics.solvers.simulate import simulate
from dashred.pipeline import time_shares
from dashred.pipeline.simulation import nominal_run
from dashred.reporting.text.summary import summary

# A damped oscillator, x'' = -4 x - 0.2 x', whose simulator lacks the damping.
DAMPING, NOISE = 0.2, 0.01
SYSTEM = {
    "system": {
        "title": "Oscillator",
        "fields": {"x": "place", "v": "velocity"},
        "equations": {"x": "v", "v": "-4*x"},
        "start": {"x": 1.0, "v": 0.0},
        "spread": {"x": 0.1, "v": 0.1},
        "integrator": {"method": "rk4", "dt": 0.05},
    },
    "simulation": {"members": 24, "held_out": 8},
    "shred": {"lags": 8, "epochs": 2},
    "assimilation": {"epochs": 2},
    "surrogate": {"members": 24},
}


@pytest.fixture(scope="module")
def recording() -> pd.DataFrame:
    """Return readings of both fields, from the solution in closed form."""
    times = np.linspace(0, 12, 121)
    rate, omega = DAMPING / 2, math.sqrt(4 - DAMPING**2 / 4)
    wave, quarter = np.cos(omega * times), np.sin(omega * times)
    decay = np.exp(-rate * times)
    x = decay * (wave + rate / omega * quarter)
    v = -decay * 4 / omega * quarter
    rng = np.random.default_rng(3)
    noise = NOISE * rng.standard_normal((2, len(times)))
    return pd.DataFrame({"time": times, "x": x + noise[0], "v": v + 2 * noise[1]})


def run(recording: pd.DataFrame, **settings: Any) -> dict[str, Any]:
    problem = dashred.Problem.from_dict(SYSTEM, recording=recording, overrides=settings)
    return dict(problem.discover(seed=0).findings)


def test_a_budget_that_suffices_changes_nothing(recording: pd.DataFrame) -> None:
    default, longer = run(recording), run(recording, budget=5000.0)
    for findings in (default, longer):
        assert findings["verdict"] == "missing-term"
        assert "budget" not in findings
        findings.pop("input")
    assert default == longer


def test_a_spent_budget_gives_an_honest_verdict(
    recording: pd.DataFrame, monkeypatch: pytest.MonkeyPatch
) -> None:
    # All stages after the simulations end before they begin.
    for stage in set(time_shares.ENDS) - {"simulate", "simulate the ensemble"}:
        monkeypatch.setitem(time_shares.ENDS, stage, -1.0)
    began = time.monotonic()
    findings = run(recording, budget=200.0)
    assert time.monotonic() - began < 100
    assert findings["verdict"] == "not-converged"
    [cause] = findings["causes"] or []
    assert cause["reason"] == "budget"
    assert "budget of 200 s" in cause["says"]
    assert findings["budget"]["seconds"] == 200.0
    left_out = findings["budget"]["not_tried"]
    assert {"epochs 2 to 2 of SHRED", "a longer horizon", "all other causes"} <= set(left_out)
    told = summary(findings, None, {})
    assert "all other causes" in told
    # Most of the budget is left: the shares of the stages were what was too small.
    assert "Some stages used up their share of the budget of 200 s" in told
    # The noise is that of the traces, whatever the fit leaves.
    noise = findings["fit"]["noise_std"]
    assert noise == pytest.approx({"x": NOISE, "v": 2 * NOISE}, rel=0.3)
    assert set(findings["fit"]["residual_std"]) == {"x", "v"}


def test_other_causes_that_were_not_weighed_are_listed(
    recording: pd.DataFrame, monkeypatch: pytest.MonkeyPatch
) -> None:
    # The stage ends before it begins, all others have their time.
    monkeypatch.setitem(time_shares.ENDS, "compare hypotheses", -1.0)
    findings = run(recording)
    assert findings["verdict"] == "missing-term"
    assert findings["budget"]["not_tried"] == ["all other causes"]


def test_simulations_that_take_too_long_are_one_error(
    recording: pd.DataFrame, monkeypatch: pytest.MonkeyPatch
) -> None:
    def slow(system: Any, start: Any, times: Any, progress: Any = None) -> Any:
        progress(0.5)
        return simulate(system, start, times, progress=progress)

    monkeypatch.setattr(nominal_run, "simulate", slow)
    with pytest.raises(dashred.InputError, match=r"budget of 0\.01 s"):
        run(recording, budget=0.01)
