"""A periodic forcing too fast for a free forcing is found; none is found if there is none."""

from __future__ import annotations

import math
from pathlib import Path

import pytest
import torch

from dashred.inference.fit.fitted_law import build_law
from dashred.inference.fit.least_squares import NormalEquations
from dashred.inference.fit.levenberg_marquardt import minimise
from dashred.inference.forward.candidates import Candidate
from dashred.inference.hypotheses.extended import periodic_forcing
from dashred.inference.hypotheses.extended.periodic_forcing import (
    KNOTS,
    Wave,
    _frequency_grid,
    _select_waves,
    fit_periodic_laws,
)
from dashred.inference.hypotheses.hypothesis_fit import HypothesisFit
from dashred.physics.forcing_basis import ForcingBasis
from dashred.physics.terms.library import build_library, evaluate_terms, resolve
from tests import laws
from tests.waves import Waves, fitted

SIGMA = 0.02
FREQUENCY = 6.33


def hum(waves: Waves, frequency: float) -> Candidate:
    """Return a wave in time whose frequency and phase are not on the search grid."""
    library = build_library(waves.system, {"u": [f"sin({frequency}*t + 0.7)"]})
    return Candidate(str(library[0]), "u", resolve(waves.system, library), 1.0)


def null_of(
    waves: Waves, xi: float, sigma: float = SIGMA, frequency: float = FREQUENCY
) -> HypothesisFit:
    recorded = waves.recorded(sigma, 3, [(hum(waves, frequency), xi)] if xi else [])
    null = waves.objective(recorded, sigma)
    found = minimise(null, fitted(null), 6, 1e-4)
    return HypothesisFit(build_law(null, found, found.cost), null, found.phi)


def test_a_wave_in_time_is_found(waves: Waves) -> None:
    null = null_of(waves, 0.6, 0.005)
    found = sorted(fit_periodic_laws(null, waves.size, 9), key=lambda fit: fit.law.score)
    best = found[0].law
    sine, cosine = best.candidates
    assert [c.equation for c in (sine, cosine)] == ["u", "u"] and best.is_extended
    assert float(sine.name[4:-3]) == pytest.approx(FREQUENCY, rel=0.01)
    assert float(best.coefficients.norm()) == pytest.approx(0.6, rel=0.05)
    assert best.score < null.law.score - 50 and best.chi2 < 1.1
    # A wave in the other equation may fit as well. Each frequency occurs only once per equation.
    assert {fit.law.candidates[0].equation for fit in found[1:]} <= {"u", "v"}


@pytest.mark.slow
def test_a_drift_does_not_become_a_wave_of_zero_frequency(
    waves: Waves, monkeypatch: pytest.MonkeyPatch
) -> None:
    null = null_of(waves, 0.3, 0.005, frequency=0.02)
    # A wave explains too little of a drift. Without that rule, a wave that becomes a trend is left
    # out: the others are faster than one period over the record, which is 10 long.
    assert fit_periodic_laws(null, waves.size, 9) == []
    monkeypatch.setattr(periodic_forcing, "MIN_EXPLAINED_SHARE", 0.0)
    found = [float(c.law.candidates[0].name[4:-3]) for c in fit_periodic_laws(null, waves.size, 9)]
    assert found and min(found) > 1.01 * 2 * math.pi / 10


def test_no_wave_is_found_in_noise(waves: Waves) -> None:
    assert fit_periodic_laws(null_of(waves, 0.0), waves.size, 9) == []


def test_a_wave_below_the_noise_is_not_found(waves: Waves) -> None:
    null = null_of(waves, 0.01)
    assert all(c.law.score > null.law.score - 6 for c in fit_periodic_laws(null, waves.size, 9))


@pytest.mark.parametrize("middle", [0.0, 5.0, 12.3])
def test_waves_of_two_frequencies_agree_at_the_given_time(middle: float) -> None:
    wave = Wave("u", 3.0, 0.3, -0.8)
    other = wave.at(3.01, middle)

    def value(of: Wave, t: float) -> float:
        return of.sine * math.sin(of.frequency * t) + of.cosine * math.cos(of.frequency * t)

    assert value(other, middle) == pytest.approx(value(wave, middle), abs=1e-12)
    assert math.hypot(other.sine, other.cosine) == pytest.approx(math.hypot(0.3, 0.8))


def test_the_slope_is_the_derivative_by_frequency(waves: Waves) -> None:
    wave, middle, step = Wave("u", 3.0, 0.3, -0.8), 5.0, 1e-3
    times = [4.0, 5.0, 6.3]
    slope = build_library(waves.system, {"u": [wave.slope(middle)]})
    states = torch.zeros((1, 2, 32), dtype=torch.float64)
    found = [float(evaluate_terms(waves.system, slope, states, t)[0, 0, 0]) for t in times]
    before, after = wave.at(3.0 - step, middle), wave.at(3.0 + step, middle)
    for t, derivative in zip(times, found, strict=True):
        values = [
            of.sine * math.sin(of.frequency * t) + of.cosine * math.cos(of.frequency * t)
            for of in (before, after)
        ]
        assert derivative == pytest.approx((values[1] - values[0]) / (2 * step), abs=1e-5)


OSCILLATOR = """
system:
  title: a mass on a spring
  fields: {x: position, v: velocity}
  equations: {x: v, v: -x}
  start: {x: 1, v: 0}
  integrator: {dt: 0.1}
recording: {twin: a, sensors: 1, noise: 0, duration: 4, every: 0.1}
"""


@pytest.mark.parametrize(("driven", "found"), [("x", set()), ("v", {"v"})])
def test_an_equation_that_defines_a_rate_gets_no_wave(
    tmp_path: Path, driven: str, found: set[str]
) -> None:
    """The readings are exactly those of a wave in one of the two equations."""
    system = laws.declared(tmp_path, OSCILLATOR)
    times = torch.linspace(0, 10, 201, dtype=torch.float64)
    basis, grid = ForcingBasis.over(system, times, 1, KNOTS), _frequency_grid(times)
    generator = torch.Generator().manual_seed(3)
    jacobian = torch.randn((200, 2, KNOTS), dtype=torch.float64, generator=generator)
    wave = (grid[9] * basis.knots).sin()
    residuals = -jacobian[:, system.fields.index(driven)] @ wave
    size, none = torch.ones(2, dtype=torch.float64), torch.zeros(2 * KNOTS, dtype=torch.float64)
    normal = NormalEquations(jacobian.flatten(1), none + 1e-6, none, residuals)
    limit = -0.5 * float(residuals.square().sum())
    waves = _select_waves(normal, system, basis, grid, size, limit)
    assert {each.equation for each in waves} == found


def test_no_wave_is_faster_than_the_samples_resolve() -> None:
    times = torch.linspace(0.0, 0.35, 12, dtype=torch.float64)[:, None]
    assert float(_frequency_grid(times)[-1]) < math.pi * 11 / 0.35
    dense = torch.linspace(0.0, 0.35, 400, dtype=torch.float64)[:, None]
    assert float(_frequency_grid(dense)[-1]) > 2 * math.pi * 25 / 0.35
