"""PDE-FIND on a field that nobody has: right without noise, and noise is taken off."""

from __future__ import annotations

import dataclasses
import math
from pathlib import Path

import numpy as np
import pytest
import torch

from dashred.config import load_config
from dashred.evaluation.comparison.pde_find import low_rank, pde_find, wiener
from dashred.physics.solvers.simulate import simulate
from dashred.physics.system import System
from dashred.physics.terms.library import build_library

TIMES = 0.05 * torch.arange(81, dtype=torch.float64)


@pytest.fixture(params=["insulated", "fixed", "periodic"])
def bar(request: pytest.FixtureRequest, tmp_path: Path) -> System:
    path = tmp_path / "bar.yaml"
    path.write_text(
        "system:\n  title: bar\n"
        f"  axes: {{x: {{length: 6, points: 32, ends: {request.param}}}}}\n"
        "  fields: {T: temperature}\n  equations: {T: 0.3*lap(T)}\n"
        "  start: {T: 0}\n  integrator: {dt: 0.01}\nrecording: {twin: a, every: 0.1}\n"
    )
    config = load_config([f"conf={path}"], entry="test")
    return System(config.system, config.where)


def test_the_term_that_is_missing_is_found(bar: System) -> None:
    lossy = dataclasses.replace(bar.config, equations={"T": "0.3*lap(T) - 0.2*T"})
    truth = bar.with_config(lossy)
    x = bar.grid.own_coordinates["x"]
    along = {"insulated": torch.cos, "fixed": torch.sin, "periodic": torch.sin}
    wave = along[bar.axes[0].ends]
    step = math.pi / 3 if bar.axes[0].periodic else math.pi / 6
    start = wave(step * x) + 0.5 * wave(2 * step * x) - 0.4 * wave(3 * step * x)
    states = simulate(truth, bar.grid.ring(start)[None, None], TIMES)[0]
    own = bar.grid.own(states)
    library = build_library(bar, {"T": ["T", "T**2", "T**3", "d(T, x, 2)"]})
    [term] = pde_find(bar, library, TIMES, own, 0.001, np.random.default_rng(0))
    assert term["term"] == "T"
    assert term["coefficient"] == pytest.approx(-0.2, rel=0.02)


def test_a_wave_is_left_and_noise_is_not() -> None:
    x = torch.linspace(0, 2 * math.pi, 65, dtype=torch.float64)[:-1]
    clean = torch.sin(x).expand(50, 1, 64)
    rng = np.random.default_rng(1)
    noisy = clean + 0.1 * torch.from_numpy(rng.standard_normal(clean.shape))
    found = wiener(noisy, 0.1, (-1,))
    assert float((found - clean).square().mean()) < 0.2 * float((noisy - clean).square().mean())


def test_low_rank_takes_off_noise_alone() -> None:
    rng = np.random.default_rng(2)
    clean = np.outer(np.sin(np.arange(60) / 7), rng.standard_normal(200))
    noisy = clean + 0.1 * rng.standard_normal(clean.shape)
    found = low_rank(noisy, 0.1)
    assert np.linalg.matrix_rank(found, tol=1e-6) == 1
    assert np.mean((found - clean) ** 2) < 0.1 * 0.1**2
    assert not low_rank(0.1 * rng.standard_normal((60, 200)), 0.1).any()
    np.testing.assert_allclose(low_rank(noisy, 0.0), noisy, rtol=0, atol=1e-12)
