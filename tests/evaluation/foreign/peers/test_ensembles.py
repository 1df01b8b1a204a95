"""Ensemble smoothers of other packages on recordings with a known law."""

from __future__ import annotations

from dataclasses import replace

import pytest

from dashred.evaluation.foreign.peers.ensembles.ensemble_smoother import smooth_ensemble
from dashred.evaluation.foreign.peers.ensembles.iterative_smoother import smooth_iteratively
from dashred.evaluation.foreign.peers.measured import Measured, NoAnswerError
from tests.evaluation.foreign.peers.recordings import damped_oscillator, lorenz


def first_samples(given: Measured, count: int) -> Measured:
    return replace(given, times=given.times[:count], readings=given.readings[:count])


def test_the_ensemble_smoother_finds_a_damping() -> None:
    pytest.importorskip("iterative_ensemble_smoother")
    [term] = smooth_ensemble(damped_oscillator())
    assert (term["equation"], term["term"]) == ("v", "v")
    assert term["coefficient"] == pytest.approx(-0.3, rel=0.05)


def test_the_ensemble_smoother_has_no_answer_where_members_blow_up_or_do_not_fit() -> None:
    pytest.importorskip("iterative_ensemble_smoother")
    with pytest.raises(NoAnswerError, match=r"blow up|variance of the noise|diverged"):
        smooth_ensemble(lorenz())


@pytest.mark.slow
def test_the_iterative_smoother_finds_the_term_of_a_chaotic_system() -> None:
    pytest.importorskip("dapper")
    [term] = smooth_iteratively(first_samples(lorenz(), 100))
    assert (term["equation"], term["term"]) == ("y", "x*z")
    assert term["coefficient"] == pytest.approx(-1.0, rel=0.05)


@pytest.mark.slow
def test_the_iterative_smoother_has_no_answer_without_the_term() -> None:
    pytest.importorskip("dapper")
    given = first_samples(damped_oscillator(), 60)
    with pytest.raises(NoAnswerError, match=r"blow up|variance of the noise|diverged"):
        smooth_iteratively(replace(given, library=given.library[:1]))
