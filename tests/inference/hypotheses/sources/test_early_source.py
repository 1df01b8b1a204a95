"""A source is found before any law is selected, and nothing else is taken for one."""

from __future__ import annotations

import math
from dataclasses import replace

import pytest
import torch

from dashred.core.budget import Deadline, OutOfTimeError
from dashred.inference.fit.least_squares import LeastSquaresProblem
from dashred.inference.hypotheses.first_part import FirstPart, first_parts
from dashred.inference.hypotheses.sources.bump import Bump
from dashred.inference.hypotheses.sources.early_source import find_early_source
from dashred.inference.hypotheses.sources.find_source import FoundSource
from dashred.inference.hypotheses.terms_everywhere import TermsEverywhere, best_terms_everywhere
from tests.channel import Channel

PLACE, WIDTH, HEIGHT = 8.2, 0.4, 0.3
FIRST = 6
# Far more than the rms of the tendency of the channel, 0.06.
STRONG = 10.0


def first_part(channel: Channel, null: LeastSquaresProblem) -> FirstPart | None:
    """Return the first part in which something is missing."""
    phi = torch.zeros(null.modes, dtype=torch.float64)
    return next(first_parts(null, phi, FIRST, channel.size), None)


def search(channel: Channel, hidden: list[tuple[str, float]], seed: int = 0) -> FoundSource | None:
    """Search in a recording under hidden terms, from the start that the simulator states."""
    null = channel.objective(channel.recorded(hidden, seed))
    part = first_part(channel, null)
    if part is None:
        return None
    everywhere = best_terms_everywhere(channel.objective(null.recorded, channel.library), part)
    return find_early_source(null, part, channel.size, everywhere, 4, lambda share, text: None)


def bump_times(channel: Channel, course: str) -> str:
    """Return a bump times a course in the equation language."""
    return f"{Bump((PLACE,), WIDTH).text(channel.system)}*{course}"


def test_a_steady_source_over_the_whole_record(channel: Channel) -> None:
    found = search(channel, [(bump_times(channel, "1"), HEIGHT)])
    assert found is not None
    assert found.fit.source.bump.centre[0] == pytest.approx(PLACE, abs=0.1)
    assert float(found.fit.source.amplitudes[0]) == pytest.approx(HEIGHT, rel=0.1)
    assert found.fit.chi2 / found.fit.objective.noise.count < 1.2


def test_a_source_far_stronger_than_the_simulator(channel: Channel) -> None:
    found = search(channel, [(bump_times(channel, "1"), STRONG)])
    assert found is not None
    assert found.fit.source.bump.centre[0] == pytest.approx(PLACE, abs=0.01)
    assert float(found.fit.source.amplitudes[0]) == pytest.approx(STRONG, rel=0.01)


def test_a_pulsating_source_has_its_period(channel: Channel) -> None:
    found = search(channel, [(bump_times(channel, "(1 + sin(2*pi*t/2.3))"), HEIGHT)], seed=1)
    assert found is not None and found.fit.source.course.period is not None
    assert found.fit.source.course.period == pytest.approx(2.3, abs=0.1)


@pytest.mark.parametrize(
    ("term", "size"),
    [("d(c, x)", -0.1), ("cos(2*pi*x/10)", 0.1), ("step(t - 3.1)", 0.1)],
)
def test_what_acts_everywhere_is_no_source(channel: Channel, term: str, size: float) -> None:
    assert search(channel, [(term, size)]) is None


def test_noise_is_no_source(channel: Channel) -> None:
    assert search(channel, []) is None


@pytest.mark.parametrize("is_source", [False, True])
def test_terms_everywhere_explain_only_what_acts_everywhere(
    channel: Channel, is_source: bool
) -> None:
    hidden = (bump_times(channel, "1"), HEIGHT) if is_source else ("c**2", -0.05)
    recorded = channel.recorded([hidden], seed=2)
    part = first_part(channel, channel.objective(recorded))
    assert part is not None
    everywhere = best_terms_everywhere(channel.objective(recorded, channel.library), part)
    assert everywhere.explain is not is_source


def test_no_source_is_fitted_where_better_terms_explain(channel: Channel) -> None:
    null = channel.objective(channel.recorded([(bump_times(channel, "1"), HEIGHT)]))
    part = first_part(channel, null)
    assert part is not None
    better = TermsEverywhere(0.0, null.noise.count, (0,), torch.zeros(1))
    late = replace(part, null=replace(part.null, deadline=Deadline(-math.inf)))
    assert find_early_source(null, late, channel.size, better, 4, lambda share, text: None) is None


def test_the_search_keeps_its_deadline(channel: Channel) -> None:
    null = channel.objective(channel.recorded([(bump_times(channel, "1"), HEIGHT)]))
    late = replace(null, deadline=Deadline(-math.inf))
    with pytest.raises(OutOfTimeError):
        first_part(channel, late)
