"""The weak form of PDE-FIND on a field with a known law."""

from __future__ import annotations

import numpy as np
import pytest

from dashred.evaluation.foreign.peers.full_state import FullState
from dashred.evaluation.foreign.peers.weak_pde import NotExpressibleError, text_of, weak_pde
from tests.evaluation.foreign.invented import RING, system_of

TIMES = np.linspace(0, 4, 61)
PLACES = np.arange(40) / 4


def full_of(equation: str) -> FullState:
    """Return waves that travel at 0.7 and spread by 0.1, with a simulator."""
    states = np.zeros((61, 1, 40))
    for wave, amplitude in ((1, 1.0), (2, 0.5), (3, 0.4)):
        k = 2 * np.pi * wave / 10
        phase = k * (PLACES - 0.7 * TIMES[:, None]) + wave
        states[:, 0] += amplitude * np.exp(-0.1 * k**2 * TIMES[:, None]) * np.sin(phase)
    return FullState(system_of({**RING, "equations": {"u": equation}}), [], TIMES, states, 0.01, 2)


def test_the_advection_that_the_simulator_lacks_is_found() -> None:
    [term] = weak_pde(full_of("0.1*lap(u)"))
    assert (term["equation"], term["term"]) == ("u", "d(u, x, 1)")
    assert term["coefficient"] == pytest.approx(-0.7, rel=0.02)


def test_nothing_is_found_where_nothing_is_missing() -> None:
    assert weak_pde(full_of("0.1*d(u, x, 2) - 0.7*d(u, x)")) == []


def test_a_simulator_beyond_the_features_is_told() -> None:
    with pytest.raises(NotExpressibleError, match="tanh"):
        weak_pde(full_of("0.1*lap(u) + tanh(u)"))


@pytest.mark.parametrize(
    ("feature", "text"),
    [
        ("1", "1"),
        ("u^2", "u**2"),
        ("u_11", "d(u, x, 2)"),
        ("u^2u_111", "u**2*d(u, x, 3)"),
        ("u v", "u*v"),
        ("u^2 vv_1", "u**2*v*d(v, x, 1)"),
    ],
)
def test_features_in_the_equation_language(feature: str, text: str) -> None:
    assert text_of(feature, ["u", "v"], "x") == text
