"""A source is found with its place, strength and period; nothing else is taken for one."""

from __future__ import annotations

import math
from dataclasses import dataclass
from types import SimpleNamespace
from typing import Any

import pytest
import torch

from dashred.core.work import COLUMN_STEPS, work_done
from dashred.inference.fit.least_squares import LeastSquaresProblem
from dashred.inference.hypotheses.free_forcing import FreeForcing, fit_free_forcing
from dashred.inference.hypotheses.sources import source_fit
from dashred.inference.hypotheses.sources.bump import Bump
from dashred.inference.hypotheses.sources.courses import Constant
from dashred.inference.hypotheses.sources.find_source import (
    FoundSource,
    _best_fit,
    find_source,
    rival_score,
)
from dashred.inference.hypotheses.sources.screening import ScreenedSource, Source, widest_bump
from dashred.inference.hypotheses.sources.source_law import fit_source_law, locate_source
from tests.channel import Channel, fitted

PLACE, WIDTH, HEIGHT = 8.2, 0.4, 0.3
AREA = WIDTH * math.sqrt(2 * math.pi)


@dataclass(frozen=True)
class Search:
    """A search for a source in a recording."""

    null: LeastSquaresProblem
    forcing: FreeForcing
    found: FoundSource | None


def search(channel: Channel, course: str | None, seed: int = 0) -> Search:
    """Search in a recording under a bump times a course; under nothing for None."""
    bump = Bump((PLACE,), WIDTH).text(channel.system)
    hidden = [(f"{bump}*{course}", HEIGHT)] if course else []
    null = channel.objective(channel.recorded(hidden, seed))
    phi = fitted(null)
    forcing, _ = fit_free_forcing(null, phi, channel.size)
    return Search(null, forcing, find_source(null, phi, forcing, channel.size, 4))


def test_a_steady_source(channel: Channel) -> None:
    found = search(channel, "1").found
    assert found is not None and isinstance(found.fit.source.course, Constant)
    null = channel.objective(channel.recorded())
    located = locate_source(null, found)
    [place], [std] = located.place, located.place_std
    assert abs(place - PLACE) < 4 * std < 0.2
    strength = HEIGHT * Bump((PLACE,), WIDTH).integral(channel.system)
    assert abs(located.strength - strength) < 4 * located.strength_std < 0.05
    assert located.period is None and located.share > 0.99
    [(begin, end)] = located.region
    assert begin < PLACE - WIDTH and end > PLACE + WIDTH


def test_a_pulsating_source(channel: Channel) -> None:
    found = search(channel, "(1 + sin(2*pi*t/2.3))", seed=1).found
    assert found is not None
    located = locate_source(channel.objective(channel.recorded()), found)
    assert located.period is not None and located.period_std is not None
    assert abs(located.period - 2.3) < 4 * located.period_std < 0.1
    assert abs(located.place[0] - PLACE) < 0.2
    assert max(located.rates) == pytest.approx(2 * HEIGHT * AREA, rel=0.1)


def test_a_source_that_begins_within_the_record(channel: Channel) -> None:
    found = search(channel, "step(t - 3.1)", seed=2).found
    assert found is not None
    located = locate_source(channel.objective(channel.recorded()), found)
    assert located.begin == pytest.approx(3.1, abs=0.2) and located.period is None


@pytest.mark.parametrize("seed", range(3))
def test_noise_is_no_source(channel: Channel, seed: int) -> None:
    assert search(channel, None, seed).found is None


def test_the_law_of_a_source_explains_the_recording(channel: Channel) -> None:
    case = search(channel, "1", seed=3)
    assert case.found is not None
    fit = fit_source_law(case.null, case.found, channel.size)
    assert fit.law.chi2 < 1.2 and fit.law.is_extended and fit.law.source is not None
    [height] = fit.law.coefficients.tolist()
    assert height == pytest.approx(HEIGHT, rel=0.1)
    assert fit.law.parts == {"c: 1", "in a box of x"}


def test_a_constant_in_the_region_rivals_a_source_and_other_terms_do_not(channel: Channel) -> None:
    case = search(channel, "(1 + sin(2*pi*t/2.3))", seed=1)
    assert case.found is not None
    everything = channel.objective(case.null.recorded, channel.library)
    assert rival_score(everything, case.found, case.forcing) > case.found.score + 1000
    steady = search(channel, "1", seed=3)
    assert steady.found is not None
    everything = channel.objective(steady.null.recorded, channel.library)
    assert rival_score(everything, steady.found, steady.forcing) < steady.found.score + 60


@pytest.mark.parametrize("text", ["step(t - 3.1)", "cos(2*pi*x/10)"])
def test_a_force_everywhere_is_no_localised_source(channel: Channel, text: str) -> None:
    null = channel.objective(channel.recorded([(text, 0.1)]))
    phi = fitted(null)
    forcing, gain = fit_free_forcing(null, phi, channel.size)
    assert gain > 100
    assert find_source(null, phi, forcing, channel.size, 4) is None


def test_a_fit_ends_when_its_bump_is_too_wide(channel: Channel) -> None:
    null = channel.objective(channel.recorded([("1", 0.1)]))
    source = Source(0, Bump((PLACE,), WIDTH), Constant(), torch.zeros(1, dtype=torch.float64))

    def fit(largest_width: float) -> tuple[float, int]:
        before = work_done().get(COLUMN_STEPS, 0)
        known = null, fitted(null), source, channel.size, source_fit.TOLERANCE
        width = source_fit.fit_source(*known, largest_width).source.bump.width
        return width, work_done()[COLUMN_STEPS] - before

    limit = 3 * widest_bump(channel.system)
    to_the_end, all_columns = fit(math.inf)
    width, columns = fit(limit)
    assert to_the_end > width > limit
    assert columns < 0.8 * all_columns


@pytest.mark.parametrize("local_cost", [50.0, 500.0, 2000.0])
def test_a_wide_fit_goes_on_if_a_local_one_seems_better(
    channel: Channel, local_cost: float, monkeypatch: pytest.MonkeyPatch
) -> None:
    """The wide source has F = 1000 when its fit ends early, and 100 at its minimum."""
    fitted_to_the_end: list[bool] = []
    null = channel.objective(channel.recorded([("1", 0.1)]))
    wide, local = (
        Source(0, Bump((PLACE,), width), Constant(), torch.zeros(1, dtype=torch.float64))
        for width in (8.0, WIDTH)
    )

    def fit_source(
        null: Any, phi: Any, source: Source, size: Any, tolerance: float, largest: float = math.inf
    ) -> SimpleNamespace:
        fitted_to_the_end.append(source is wide and largest == math.inf)
        cost = local_cost if source is local else 100.0 if largest == math.inf else 1000.0
        return SimpleNamespace(source=source, cost=cost, chi2=math.inf, phi=phi)

    monkeypatch.setattr(f"{find_source.__module__}.fit_source", fit_source)
    screened = [ScreenedSource(source, 0.0, 0.0) for source in (wide, local)]
    found, _ = _best_fit(null, fitted(null), screened, channel.size, 0.01)
    assert found.source is (local if local_cost < 100 else wide)
    assert any(fitted_to_the_end) == (local_cost < 1000)
