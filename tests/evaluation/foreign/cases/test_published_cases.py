"""The problems of other papers: their truths solve the stated equations."""

from __future__ import annotations

import numpy as np
import pytest

from dashred.evaluation.foreign.cases.case import Case
from dashred.evaluation.foreign.cases.published_cases import make_published_case
from dashred.evaluation.foreign.cases.published_problems import KS_PROBLEMS, LORENZ_PROBLEMS


def lorenz(system: str, noise: float = 0.16) -> Case:
    return Case("published", system, "term", 0, noise, 7)


@pytest.mark.parametrize("system", LORENZ_PROBLEMS)
def test_the_lorenz_system_is_that_of_the_paper(system: str) -> None:
    made = make_published_case(lorenz(system))
    truth = made.truth
    assert truth.times[1] == pytest.approx(0.01) and len(truth.times) in (400, 700, 1000)
    assert truth.states[0] == pytest.approx([-8, 8, 27])
    x, y, z = truth.states.T
    tendency = np.stack([10 * (y - x), 28 * x - y - x * z, x * y - 8 / 3 * z], axis=1)
    slope = np.gradient(truth.states, truth.times, axis=0, edge_order=2)
    np.testing.assert_allclose(slope[5:-5], tendency[5:-5], atol=0.02 * np.abs(tendency).max())
    noise = (made.readings - truth.states) / truth.states.std(axis=0)
    assert noise.std() == pytest.approx(0.16, rel=0.05)
    assert made.library is not None and len(made.library["x"]) == 10


def test_one_term_or_the_whole_law_is_left_out() -> None:
    one, whole = (make_published_case(lorenz(name)) for name in ("lorenz_4", "lorenz_10_whole"))
    assert len(one.truth.terms) == 1 and len(whole.truth.terms) == 7
    assert whole.system["equations"] == {"x": "0", "y": "0", "z": "0"}
    [term] = one.truth.terms
    assert "0" not in one.system["equations"].values() and term.coefficient != 0


def test_the_nine_cases_lack_what_the_paper_states() -> None:
    assert len(KS_PROBLEMS) == 9
    lacking = [each.removable["left out"]["u"] for each in KS_PROBLEMS.values()]
    assert len(set(lacking)) == 9
    assert sum(" + " in text for text in lacking) == 3 and sum("0.5" in t for t in lacking) == 3


def test_a_case_of_a_field_is_made() -> None:
    pytest.importorskip("pde", reason="py-pde is in the extra evaluation")
    made = make_published_case(Case("published", "ks_7", "term", 0, 0.01, 7))
    assert made.readings.shape == (101, 48) and made.truth.states.shape == (101, 1, 192)
    assert made.system["equations"] == {"u": "-u*d(u, x)/2 + -lap(u) + -lap(lap(u))"}
    # Advection is quadratic: on the fine grid it has no mean.
    assert abs(made.truth.hidden.mean()) < 1e-3 * made.truth.hidden.std()
    later = made.truth.later
    assert later is not None and later.interval == 0.005 and later.states.shape == (100, 1, 192)
    # The simulator has half of the advection, and the hidden term is the other half.
    states, hidden = made.truth.states[:-1], made.truth.hidden[:-1]
    wave = 2 * np.pi * np.fft.rfftfreq(192, 100 / 192)
    others = np.fft.irfft((wave**2 - wave**4) * np.fft.rfft(states), 192)
    rates = (later.states - states) / later.interval
    difference = rates - (2 * hidden + others)
    assert difference.std() < 0.03 * rates.std()
