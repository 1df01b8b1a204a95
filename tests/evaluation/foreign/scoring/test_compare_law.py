"""A law is exact if it adds what is hidden, and nothing else."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from dashred.evaluation.foreign.cases.case import TrueTerm, Truth
from dashred.evaluation.foreign.scoring.compare_law import covered, is_exact
from tests.evaluation.foreign.invented import DECAY, RING, system_of, term

TIMES = np.linspace(0, 5, 60)
STATES = np.stack([1.2 + np.sin(TIMES), np.cos(1.7 * TIMES)], axis=1)
SYSTEM = system_of(DECAY)


def truth(**hidden: np.ndarray) -> Truth:
    """Return a truth that lacks these tendencies, by equation."""
    columns = [hidden.get(name, np.zeros(len(TIMES))) for name in "xy"]
    terms = (TrueTerm("x", "x**2", -0.3),)
    return Truth("term", "", TIMES, STATES, np.stack(columns, axis=1), terms)


SQUARE = truth(x=-0.3 * STATES[:, 0] ** 2)


@pytest.mark.parametrize(
    ("entries", "exact"),
    [
        ([term("x", "x**2", -0.31)], True),
        ([term("x", "-2*x*x", 0.15)], True),
        ([term("x", "x**2", -0.35)], False),
        ([term("x", "x**3", -0.12)], False),
        ([term("y", "x**2", -0.3)], False),
        ([term("x", "x**2", -0.3), term("y", "y", -0.001)], False),
        ([term("x", "x**2", -0.3), term("x", "y", -0.001)], False),
        ([term("x", "x**2", -0.3), term("x", "x**2", -1.0), term("x", "x**2", 1.0)], False),
        ([term("x", "x**2", -0.15), term("x", "x*abs(x)", -0.15)], False),
        ([term("x", "no_such_name", 1.0)], False),
        ([term("x", "log(x - 5)", 1.0)], False),
        ([], False),
    ],
)
def test_a_law_of_terms(entries, exact: bool) -> None:
    assert is_exact(SYSTEM, entries, SQUARE) is exact


def test_a_product_may_be_told_multiplied_out() -> None:
    law = (TrueTerm("x", "x*(x + y)", -0.3, 2),)
    hidden = -0.3 * STATES[:, 0] * STATES.sum(axis=1)
    told = [term("x", "x**2", -0.3), term("x", "x*y", -0.3)]
    assert is_exact(SYSTEM, told, replace(truth(x=hidden), terms=law))


@pytest.mark.parametrize(
    ("entries", "exact"),
    [
        ([term("x", "x**2", -0.31)], True),
        ([term("x", "x**2", -0.35)], False),
        ([term("x", "x**2", -0.3), term("x", "y", -0.001)], False),
        ([], False),
    ],
)
def test_the_true_term_is_exact_where_the_hidden_force_rests(entries, exact: bool) -> None:
    resting = np.where(TIMES < 2, -0.3 * STATES[:, 0] ** 2, 0.0)
    assert is_exact(SYSTEM, entries, truth(x=resting)) is exact


def test_a_force_without_a_name_may_be_told_by_several_terms() -> None:
    nameless = replace(SQUARE, terms=())
    told = [term("x", "x**2", -0.15), term("x", "x*abs(x)", -0.15)]
    assert is_exact(SYSTEM, told, nameless)


def test_terms_of_other_methods_have_no_region() -> None:
    told = {"equation": "x", "term": "x**2", "coefficient": -0.31}
    assert is_exact(SYSTEM, [told], SQUARE)
    assert not is_exact(SYSTEM, [{**told, "coefficient": -0.35}], SQUARE)


def test_a_parameter_that_does_the_same_is_exact() -> None:
    changed = {"equation": None, "parameter": "k", "term": "k", "to": 0.8, "ci95": [0.7, 0.9]}
    hidden = truth(x=-0.3 * STATES[:, 0])
    assert is_exact(SYSTEM, [changed], hidden)
    assert not is_exact(SYSTEM, [{**changed, "to": 0.7}], hidden)


def test_intervals_of_told_terms_of_the_true_law() -> None:
    right = term("x", "-x**2", 0.3)
    assert covered(SYSTEM, [right], SQUARE) == [True]
    assert covered(SYSTEM, [{**right, "ci95": [0.31, 0.33]}], SQUARE) == [False]
    assert covered(SYSTEM, [term("x", "x**3", -0.3)], SQUARE) == []


def ring_truth(begin: float, end: float) -> Truth:
    places = np.arange(40) / 4
    states = np.broadcast_to(1.5 + np.sin(2 * np.pi * places / 10), (6, 1, 40)).copy()
    inside = (places - begin) % 10 <= (end - begin) % 10
    hidden = -0.4 * states * inside
    return Truth("region", "", np.arange(6.0), states, hidden, region=(begin, end))


@pytest.mark.parametrize(
    ("told", "exact"),
    [
        ((8.5, 2.0), True),
        ((8.5, 12.0), True),
        ((-1.5, 2.0), True),
        ((9.0, 1.6), True),
        ((4.0, 7.0), False),
        ((6.0, 4.0), False),
    ],
)
def test_a_region_may_run_across_the_seam(told: tuple[float, float], exact: bool) -> None:
    region = [{"axis": "x", "from": told[0], "to": told[1]}]
    entries = [term("u", "u", -0.4, region=region)]
    assert is_exact(system_of(RING), entries, ring_truth(8.5, 2.0)) is exact


def test_in_a_region_the_term_has_to_be_right_too() -> None:
    region = [{"axis": "x", "from": 3.0, "to": 6.0}]
    system, hidden = system_of(RING), ring_truth(3.0, 6.0)
    assert is_exact(system, [term("u", "u", -0.41, region=region)], hidden)
    assert not is_exact(system, [term("u", "u", -0.6, region=region)], hidden)
    assert not is_exact(system, [term("u", "1", -0.4, region=region)], hidden)
    assert not is_exact(system, [term("u", "u", -0.4)], hidden)


def test_the_edges_of_a_region_are_not_compared() -> None:
    """A hidden term rises smoothly at its edges; a told region begins and ends at once."""
    region = [{"axis": "x", "from": 3.0, "to": 6.0}]
    system, truth = system_of(RING), ring_truth(0.0, 9.99)
    places = np.arange(40) / 4
    rise = 0.5 * (np.tanh((places - 3.0) / 0.1) - np.tanh((places - 6.0) / 0.1))
    hidden = replace(truth, hidden=truth.hidden * rise, region=(3.0, 6.0))
    assert is_exact(system, [term("u", "u", -0.4, region=region)], hidden)
    assert not is_exact(system, [term("u", "u", -0.5, region=region)], hidden)


@pytest.mark.parametrize(
    ("interval", "exact"),
    [([-0.55, -0.38], True), ([-0.55, -0.42], False), ([-0.9, -0.1], False)],
)
def test_in_a_region_a_narrow_interval_may_contain_the_coefficient(interval, exact: bool) -> None:
    """The strength of a term and the width of its region compensate each other."""
    region = [{"axis": "x", "from": 3.3, "to": 5.7}]
    told = {**term("u", "u", -0.47, region=region), "ci95": interval}
    assert is_exact(system_of(RING), [told], ring_truth(3.0, 6.0)) is exact
