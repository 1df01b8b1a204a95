"""MEDIDA on fields with a known law."""

from __future__ import annotations

import numpy as np
import pytest

from dashred.evaluation.foreign.cases.case import Array, LaterStates
from dashred.evaluation.foreign.peers.full_state import FullState
from dashred.evaluation.foreign.peers.measured import NoAnswerError
from dashred.evaluation.foreign.peers.medida import (
    medida_law,
    model_errors,
    sparse_coefficients,
    terms_of,
)
from tests.evaluation.foreign.invented import RING, system_of

INTERVAL = 0.005
TIMES = np.linspace(0, 4, 81)
PLACES = np.arange(40) / 4


def waves(times: Array) -> Array:
    """Return waves that travel at 0.7 and spread by 0.1, ``(time, field, point)``."""
    states = np.zeros((len(times), 1, 40))
    for wave, amplitude in ((1, 10.0), (2, 5.0), (3, 4.0)):
        k = 2 * np.pi * wave / 10
        phase = k * (PLACES - 0.7 * times[:, None]) + wave
        states[:, 0] += amplitude * np.exp(-0.1 * k**2 * times[:, None]) * np.sin(phase)
    return states


def full_of(equation: str, noise: float) -> FullState:
    """Return the waves with a simulator, and their states a short time later."""
    system = system_of({**RING, "equations": {"u": equation}})
    later = LaterStates(INTERVAL, waves(TIMES[:-1] + INTERVAL))
    return FullState(system, [], TIMES, waves(TIMES), noise, 2, later)


@pytest.mark.parametrize("noise", [1e-6, 5e-4])
def test_the_advection_that_the_simulator_lacks_is_found(noise: float) -> None:
    [term] = medida_law(full_of("0.1*lap(u)", noise), 0.0)
    assert (term["equation"], term["term"]) == ("u", "d(u, x, 1)")
    assert term["coefficient"] == pytest.approx(-0.7, rel=0.02)


def test_the_noise_of_the_later_state_is_in_the_model_errors() -> None:
    """It is much smaller than the spread of the ensemble, so that the gain is nearly one."""
    full = full_of("0.1*lap(u)", 0.005)
    clean, noisy = (model_errors(full, noise)[1].std() for noise in (0.0, 0.005))
    expected = 0.005 * float(full.std.item()) / INTERVAL
    assert noisy**2 - clean**2 == pytest.approx(expected**2, rel=0.15)


def test_a_simulator_that_blows_up_gives_no_answer() -> None:
    with pytest.raises(NoAnswerError, match="blows up"):
        medida_law(full_of("1e4*u**3", 1e-6), 0.0)


def test_the_terms_are_those_of_the_paper() -> None:
    texts = terms_of(system_of(RING))
    assert len(texts) == 24 == len(set(texts))
    assert {"u", "u**4", "d(u, x, 4)", "u*d(u, x, 1)"} <= set(texts)


@pytest.mark.parametrize("noise", [0.5, 5.0])
def test_irrelevant_columns_have_no_coefficient(noise: float) -> None:
    rng = np.random.default_rng(4)
    columns = rng.standard_normal((9000, 6)) * np.array([1, 10, 1, 1, 1, 5])
    target = 2 * columns[:, 1] - 0.5 * columns[:, 2] + noise * rng.standard_normal(9000)
    law = sparse_coefficients(columns, target)
    assert np.flatnonzero(law).tolist() == [1, 2]
    np.testing.assert_allclose(law[[1, 2]], [2, -0.5], rtol=0.2)
