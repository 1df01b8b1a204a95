"""The localised source of a discovery: its own, or a constant in a region."""

from __future__ import annotations

import math
from dataclasses import replace
from pathlib import Path

import pytest
import torch

from dashred.inference.fit.located_source import LocatedSource
from dashred.inference.forward.law_block import restrict_to_window
from dashred.inference.hypotheses.result import Discovery
from dashred.inference.results.source_of_law import source_of_discovery
from dashred.inference.results.verdict import verdict
from dashred.physics.system import System
from dashred.physics.window import box
from tests import laws

TIMES = torch.linspace(0, 4, 5, dtype=torch.float64)
SOURCE = LocatedSource(
    equation="u", axes=("x",), place=(2.0,), place_std=(0.1,), region=((1.5, 2.5),), period=None,
    period_std=None, begin=None, begin_std=None, strength=0.3, strength_std=0.01, share=1.0,
    times=(0.0, 1.0), rates=(0.3, 0.3),
)  # fmt: skip


@pytest.fixture
def flow(tmp_path: Path) -> System:
    return laws.declared(tmp_path)


def in_box(flow: System, text: str, centre: float, half: float) -> Discovery:
    """A discovery of a term in a region."""
    [axis] = flow.axes
    window = box(axis).at((centre, half, math.log(0.1)))
    local = restrict_to_window([laws.term(flow, "u", text)], window)
    return laws.discovery(laws.law(local, [0.4], std=0.02, edges=(0.03, 0.01, 0.2)))


def test_a_constant_in_a_region_is_a_source(flow: System) -> None:
    found = source_of_discovery(flow, in_box(flow, "1", 0.2, 0.5), TIMES)
    assert found is not None and found.equation == "u"
    assert found.strength == pytest.approx(0.4)
    assert found.strength_std == pytest.approx(2 * math.hypot(0.5 * 0.02, 0.01 * 0.4))
    [(begin, end)] = found.region
    assert begin == pytest.approx(2 * math.pi - 0.3) and end == pytest.approx(0.7)
    assert found.times == (0.0, 4.0) and found.share == 1.0


def test_another_term_in_a_region_is_none(flow: System) -> None:
    assert source_of_discovery(flow, in_box(flow, "u", 2.0, 0.5), TIMES) is None
    assert source_of_discovery(flow, laws.discovery(laws.law()), TIMES) is None


def test_a_source_of_the_discovery_is_kept(flow: System) -> None:
    discovery = replace(in_box(flow, "u", 2.0, 0.5), source=SOURCE)
    assert source_of_discovery(flow, discovery, TIMES) is SOURCE


def test_the_law_of_a_steady_source_is_no_rival_of_a_constant_in_a_region(flow: System) -> None:
    candidate = replace(laws.term(flow, "u", "exp(cos(x - 2) - 1)"), is_extended=True)
    source = replace(laws.law([candidate], [0.3], score=2.0), source=SOURCE)
    best = in_box(flow, "1", 2.0, 0.5).best
    assert verdict(laws.discovery(best, source))[0] == "missing-term"
    kind, [cause, *_] = verdict(laws.discovery(source))
    assert kind == "outside-library" and cause["source"] == "u"
    pulsating = replace(source, source=replace(SOURCE, period=2.0))
    assert pulsating.parts > best.parts
