"""Terms that are needless beside sensor faults are dropped, also the only one."""

from __future__ import annotations

import pytest

from dashred.inference.hypotheses.comparison.needless_terms import drop_needless_terms
from tests.inference.hypotheses.comparison.test_backward_elimination import fits
from tests.waves import Waves

PENALTY = 10.0


def test_the_only_term_is_dropped_if_it_does_nothing(waves: Waves) -> None:
    law, nothing = fits(waves, 0.0)
    [found] = drop_needless_terms(law, PENALTY)
    assert not found.law.candidates
    assert found.law.score == pytest.approx(nothing.law.score, abs=0.1)
    assert found.law.score < law.law.score


def test_a_term_that_does_something_is_kept(waves: Waves) -> None:
    law, _ = fits(waves, -0.25)
    assert drop_needless_terms(law, PENALTY) == []
