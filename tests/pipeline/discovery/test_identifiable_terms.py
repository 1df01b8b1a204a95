"""Of the default library what no data could tell apart is left out; a list of one's own is kept."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from dashred.config import load_config
from dashred.core.errors import InputError
from dashred.pipeline.discovery.identifiable_terms import keep_identifiable_terms
from dashred.pipeline.problem import Problem, build_problem
from dashred.pipeline.simulation.nominal_run import simulate_nominal
from dashred.pipeline.verification.verification import build_input

TEXT = """
system:
  title: hares and lynxes
  fields: {a: prey, b: predators}
  equations: {a: a - a*b, b: a*b - b}
  start: {a: 1.5, b: 1}
  spread: {a: 0.1, b: 0.1}
  integrator: {dt: 0.05}
"""


def make_problem(folder: Path, *words: str) -> Problem:
    """Return two populations, never negative, as three episodes."""
    (folder / "hares.yaml").write_text(TEXT)
    t = 0.1 * np.arange(30)
    rows = np.stack([t, 1 + 0.5 * np.cos(t), 1 + 0.4 * np.sin(t)], axis=1)
    with (folder / "hares.csv").open("w") as file:
        file.write("episode,time,a,b\n")
        for name in "xyz":
            file.writelines(f"{name},{at:.1f},{a:.4f},{b:.4f}\n" for at, a, b in rows)
    return build_problem(
        load_config(
            [f"conf={folder / 'hares.yaml'}", f"recording.path={folder / 'hares.csv'}", *words],
            entry="train",
        )
    )


def test_a_field_that_is_never_negative_is_its_own_magnitude(tmp_path: Path) -> None:
    problem = make_problem(tmp_path)
    apart = keep_identifiable_terms(problem, simulate_nominal(problem, {}).states, problem.times)
    names = {(term.equation, str(term)) for term in apart.library}
    assert {("a", "1"), ("a", "a"), ("a", "a**2"), ("b", "a*b")} <= names
    assert not {("a", "sign(a)"), ("b", "a*abs(a)"), ("a", "b*abs(b)")} & names
    assert len(apart.library) == len(problem.library) - 8
    assert all(part.library == apart.library for part in (*apart.others, *apart.whole))
    left_out = build_input(apart)["library_left_out"]
    assert left_out["a: sign(a)"] == "is 1 times a number" and len(left_out) == 8
    assert "library_left_out" not in build_input(problem)


def test_a_list_of_ones_own_is_refused_with_both_named(tmp_path: Path) -> None:
    problem = make_problem(tmp_path, "library={a: [a, abs(a)]}")
    with pytest.raises(InputError, match=r"'a' and 'abs\(a\)' are proportional"):
        keep_identifiable_terms(problem, simulate_nominal(problem, {}).states, problem.times)


def test_a_list_that_can_be_told_apart_is_kept(tmp_path: Path) -> None:
    problem = make_problem(tmp_path, "library={a: [a, a**2]}")
    assert (
        keep_identifiable_terms(problem, simulate_nominal(problem, {}).states, problem.times)
        is problem
    )


def test_where_nothing_moves_the_user_is_told(tmp_path: Path) -> None:
    still = ["system.start.a=0", "system.start.b=0", "system.equations={a: -a, b: -b}"]
    problem = make_problem(tmp_path, *still)
    apart = keep_identifiable_terms(problem, simulate_nominal(problem, {}).states, problem.times)
    assert {str(term) for term in apart.library} == {"1"}
    assert build_input(apart)["library_left_out"]["a: a"] == "vanishes"
