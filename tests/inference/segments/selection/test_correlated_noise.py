"""Noise that is correlated from sample to sample: the ranking of laws and their intervals."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from dashred.inference.segments.findings.segment_laws import law_from_segments
from dashred.inference.segments.gauss_newton import fit_nodes
from dashred.inference.segments.segments import Array, cut
from dashred.inference.segments.selection.correlated_noise import residual_moments
from dashred.inference.segments.selection.correlated_ranking import (
    has_correlated_residuals,
    rank_correlated,
)
from dashred.inference.segments.selection.search import SegmentSearch
from dashred.inference.segments.selection.set_selection import SegmentLaw
from tests.inference.segments.conftest import NOISE, TIMES, Convection, Find

RHO = 0.9
DRAWS = 30
# The model error is reduced by this factor: nearly a strong constraint.
STRONG = 0.02


def correlated(seed: int, rho: float = RHO) -> Array:
    """Noise of both sensors with std NOISE and ``r_t = ρ r_{t-1} + e_t``."""
    white = np.random.default_rng(seed).standard_normal((len(TIMES), 2))
    noise = white.copy()
    for i in range(1, len(noise)):
        noise[i] = rho * noise[i - 1] + np.sqrt(1 - rho**2) * white[i]
    return NOISE * noise


def test_terms_that_follow_correlated_noise_are_left_out(
    convection: Convection, find: Find
) -> None:
    found = find(convection.states[:, :2] + correlated(0))
    assert {str(c) for c in found.terms(found.best)[0]} > {"y: y"}
    assert has_correlated_residuals(found)
    ranked = rank_correlated(found)
    law = law_from_segments(ranked, ranked.best)
    assert [str(candidate) for candidate in law.candidates] == ["y: y"]
    assert float(law.coefficients[0]) == pytest.approx(-1.0, abs=3 * float(law.std[0]))


def test_white_noise_is_not_correlated(convection: Convection, find: Find) -> None:
    assert not has_correlated_residuals(find(convection.readings))


def test_the_moments_are_those_of_the_noise(convection: Convection, find: Find) -> None:
    noise = correlated(1, 0.8)
    found = with_readings(find(convection.readings), convection.states[:, :2] + noise)
    moments = residual_moments(found.problem, found.best.members, found.best.fit)
    assert moments.counts.tolist() == [len(TIMES), len(TIMES)]
    assert moments.variance == pytest.approx(np.mean((noise / NOISE) ** 2, axis=0), rel=0.2)
    exact = (noise[1:] * noise[:-1]).sum(axis=0) / (noise**2).sum(axis=0)
    assert moments.correlation == pytest.approx(exact, abs=0.05)
    assert moments.redundancy == pytest.approx(np.mean((1 + exact) / (1 - exact)), rel=0.3)


def test_the_interval_accounts_for_the_correlation(convection: Convection, find: Find) -> None:
    clean = find(convection.readings)
    off = []
    for seed in range(DRAWS):
        found = with_readings(clean, convection.states[:, :2] + correlated(seed))
        law = law_from_segments(found, found.best)
        off.append((float(law.coefficients[0]) + 1) / float(law.std[0]))
    # As if the readings were independent, this were about 2 or more.
    assert 0.5 < np.sqrt(np.mean(np.square(off))) < 1.4


def with_readings(found: SegmentSearch, readings: Array) -> SegmentSearch:
    """Return a search with its best law refitted to other readings, without model error."""
    problem = found.problem
    segments = cut([TIMES], [readings])
    problem = replace(
        problem,
        simulator=problem.simulator.with_segments(segments),
        model_error=STRONG * problem.model_error,
    )
    members = found.best.members
    fit = fit_nodes(problem, found.best.fit.point, members, 10)
    return replace(found, problem=problem, laws=[SegmentLaw(members, fit, 0.0)])
