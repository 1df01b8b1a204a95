"""Of the default library what no data could tell apart is left out; a list of one's own is kept."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from dashred.config import load_config
from dashred.core.errors import InputError
from dashred.pipeline.discovery import identifiable_terms
from dashred.pipeline.discovery.identifiable_terms import keep_identifiable_terms
from dashred.pipeline.input.build_problem import build_problem
from dashred.pipeline.problem import Problem
from dashred.pipeline.simulation.nominal_run import simulate_nominal
from dashred.pipeline.simulation.state_samples import StateSamples, state_samples
from dashred.pipeline.verification.findings_input import build_input

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


def samples(problem: Problem) -> StateSamples:
    return state_samples(problem, simulate_nominal(problem, {}))


def test_a_field_that_is_never_negative_is_its_own_magnitude(tmp_path: Path) -> None:
    problem = make_problem(tmp_path)
    apart = keep_identifiable_terms(problem, samples(problem))
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
        keep_identifiable_terms(problem, samples(problem))


def test_a_list_that_can_be_told_apart_is_kept(tmp_path: Path) -> None:
    problem = make_problem(tmp_path, "library={a: [a, a**2]}")
    assert keep_identifiable_terms(problem, samples(problem)) is problem


def test_where_nothing_moves_the_user_is_told(tmp_path: Path) -> None:
    still = ["system.start.a=0", "system.start.b=0", "system.equations={a: -a, b: -b}"]
    problem = make_problem(tmp_path, *still)
    at_rest = simulate_nominal(problem, {}).states
    apart = keep_identifiable_terms(problem, StateSamples(problem.system, at_rest, problem.times))
    assert {str(term) for term in apart.library} == {"1"}
    assert build_input(apart)["library_left_out"]["a: a"] == "vanishes"


def pushed(tmp_path: Path, second: float) -> Problem:
    """Two episodes of a sledge that is pushed in a direction s."""
    (tmp_path / "sledge.yaml").write_text("""
system:
  title: a sledge
  fields: {v: speed}
  parameters: {a: 0.5}
  inputs: {s: direction}
  equations: {v: -v + a*s}
  start: {v: 0.1}
  spread: {v: 0.1}
  integrator: {dt: 0.1}
recording: {path: sledge.csv}
""")
    rows = [
        f"{name},{0.1 * i:.1f},{s * (0.1 + 0.01 * i)},{s}"
        for name, s in (("left", 1.0), ("right", second))
        for i in range(40)
    ]
    (tmp_path / "sledge.csv").write_text("\n".join(["episode,time,v,direction", *rows]) + "\n")
    return build_problem(load_config([f"conf={tmp_path / 'sledge.yaml'}"], entry="train"))


@pytest.mark.parametrize("second", [1.0, -1.0])
def test_an_input_with_one_value_per_episode_differs_from_a_constant(
    tmp_path: Path, second: float
) -> None:
    problem = pushed(tmp_path, second)
    library = {str(t) for t in keep_identifiable_terms(problem, samples(problem)).library}
    assert "1" in library and ("s" in library) == (second != 1.0)


def test_the_samples_are_those_of_all_episodes_with_their_inputs(tmp_path: Path) -> None:
    found = samples(pushed(tmp_path, -1.0))
    assert len(found.states) == len(found.times) == 80
    assert (found.times.diff() > 0).all()
    signal = found.system.input_signals.at(found.times.numpy())["s"]
    assert signal.tolist() == [1.0] * 40 + [-1.0] * 40


def parachute(tmp_path: Path, lowest: float) -> Problem:
    """A parachute that sinks to some height, beside a simulator that falls below the ground."""
    (tmp_path / "fall.yaml").write_text("""
system:
  title: a parachute
  fields: {h: height, v: velocity}
  equations: {h: v, v: -1}
  start: {h: 10, v: -1}
  spread: {h: 0.1, v: 0.1}
  integrator: {dt: 0.1}
recording: {path: fall.csv}
""")
    rows = [f"{0.1 * i:.1f},{10 - (10 - lowest) * i / 39:.4f}" for i in range(40)]
    (tmp_path / "fall.csv").write_text("\n".join(["time,h", *rows]) + "\n")
    return build_problem(load_config([f"conf={tmp_path / 'fall.yaml'}"], entry="train"))


@pytest.mark.parametrize("rows", [2000, 10])
@pytest.mark.parametrize("lowest", [1.0, -5.0])
def test_a_sign_that_no_reading_changes_is_left_out(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, lowest: float, rows: int
) -> None:
    monkeypatch.setattr(identifiable_terms, "MOST_ROWS", rows)
    problem = parachute(tmp_path, lowest)
    found = samples(problem)
    assert found.states[:, 0].min() < 0
    library = {str(term) for term in keep_identifiable_terms(problem, found).library}
    assert {"1", "h", "h**2", "v"} <= library
    assert ("sign(h)" in library) == ("h*abs(h)" in library) == (lowest < 0)
