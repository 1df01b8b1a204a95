"""Metric names: readable, invertible and accepted by MLflow."""

import re

import pytest
from hypothesis import given
from hypothesis import strategies as st

from dashred.core.mlflow.metric_names import (
    MAX_LENGTH,
    metric_name,
    slug,
    term_key,
    term_table,
    unslug,
)

READABLE = {
    "1": "1",
    "u": "u",
    "lam": "lam",
    "u**3": "u.pow3",
    "u*lam": "u.lam",
    "u**2*lam": "u.pow2.lam",
    "d(u, x)": "u_x",
    "d(u, x, 2)": "u_xx",
    "d(u, x, 3)**2": "u_xxx.pow2",
    "d(u**2, x)": "u.pow2_x",
    "u*d(lam, x)": "u.lam_x",
    "lap(u)": "lap.of.u",
    "lap(lap(u))": "lap.of.lap.of.u",
    "u*inv_lap(u)": "u.inv_lap.of.u",
    "grad2(u)": "grad2.of.u",
}
SPELT = {
    "": "-",
    "u + 1": "-u .plus. 1",
    "d(u,x)": "-d.open.u.comma.x.close.",
    "u_x": "-u_x",
    "exp((u - u_c)/alpha)": "-exp.open..open.u .minus. u_c.close..over.alpha.close.",
    "0.5": "-0.dot.5",
    "λ": "-.x3bb.",
    "..": "-.dot..dot.",
}

FRAGMENTS = ("u", "lam", "u_x", "pow2", "of", "d(u, x)", "lap(", "x", "**", "*", "_", ".", "3", "-")
EXPRESSIONS = st.lists(st.sampled_from([*FRAGMENTS, ")", ", ", "/", " ", "+"])).map("".join)
TEXTS = st.one_of(st.text(), EXPRESSIONS)


@pytest.mark.parametrize(("term", "expected"), [*READABLE.items(), *SPELT.items()])
def test_the_slug_is_the_readable_one(term: str, expected: str) -> None:
    assert slug(term) == expected
    assert unslug(expected) == term


@given(TEXTS)
def test_every_text_reads_back(term: str) -> None:
    assert unslug(slug(term)) == term


@given(TEXTS, TEXTS)
def test_two_texts_never_share_a_slug(first: str, second: str) -> None:
    assert (slug(first) == slug(second)) == (first == second)


@given(TEXTS)
def test_unslug_refuses_what_is_no_slug(text: str) -> None:
    try:
        term = unslug(text)
    except ValueError:
        return
    assert slug(term) == text


@given(TEXTS, TEXTS)
def test_mlflow_accepts_every_metric_name(equation: str, term: str) -> None:
    name = metric_name("alg1", equation, term)
    parts = name.split("/")
    # MLflow's two rules: these characters only, and a name that is a plain relative path.
    assert re.fullmatch(r"[A-Za-z0-9_\-. ]+", "".join(parts))
    assert len(parts) == 3
    assert not {"", ".", ".."} & set(parts)


def test_metric_names_are_grouped_by_algorithm_and_equation() -> None:
    assert metric_name("alg1", "u", "u**3") == "alg1/u/u.pow3"


def test_a_term_too_long_for_mlflow_keeps_a_key_of_its_own() -> None:
    first, second = "u*" * 200 + "u", "u*" * 200 + "lam"
    assert len(term_key(first)) == len(term_key(second)) == MAX_LENGTH
    assert term_table([first, second, "u**3"]) == {
        term_key(first): first,
        term_key(second): second,
        "u.pow3": "u**3",
    }
    assert len(term_table([first, second])) == 2
    assert len(metric_name("alg1", first, second)) <= 250
