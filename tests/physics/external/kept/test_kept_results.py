"""Results of expensive calls are found on disk, as long as nothing has changed."""

from __future__ import annotations

import time
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from dashred.physics.external.adapters.function import FunctionAdapter
from dashred.physics.external.kept import kept_results
from dashred.physics.external.stepped import SteppedProgram
from dashred.physics.grids.grid import Grid


@pytest.fixture(autouse=True)
def own_state_folder(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    monkeypatch.setenv("XDG_STATE_HOME", str(tmp_path / "state"))
    return tmp_path / "state" / "dashred" / "results"


class Slow(FunctionAdapter):
    """``du/dt = -k u``, one state in 6 ms; a state above 90 fails."""

    def __init__(self, contents: str = "a", seconds: float = 0.006) -> None:
        super().__init__(self.step, ("u",), "mypkg.step", "mine.yaml:7")
        self.calls, self.contents, self.seconds = 0, contents, seconds

    def step(self, state, t, dt, inputs, parameters):
        """See the class."""
        self.calls += 1
        time.sleep(self.seconds)
        if state["u"] > 90:
            raise ValueError("too large")
        return {"u": float(state["u"]) * (1 - dt * parameters["k"])}

    def sha256(self) -> str:
        """Contents are given by the test."""
        return self.contents


def stepped(adapter: Slow, states: list[float], keep: bool = True, **over: Any) -> np.ndarray:
    column = np.array(states)[:, None]
    given: dict[str, Any] = {"t": 0 * column[:, 0], "dt": np.full(len(column), 0.1), "inputs": {}}
    given |= {"parameters": {"k": 2.0}} | over
    return SteppedProgram(adapter, Grid(()), keep).step(column, **given)


def test_a_second_analysis_calls_nothing_again() -> None:
    first, second = Slow(), Slow()
    states = [1.0, 2.0, 3.0]
    np.testing.assert_array_equal(stepped(first, states), stepped(second, states))
    assert first.calls > 3 and second.calls == 0
    np.testing.assert_allclose(stepped(second, [*states, 4.0])[-1], 3.2)
    assert second.calls == 1


@pytest.mark.parametrize(
    "over",
    [
        {"t": np.ones(1)},
        {"dt": np.full(1, 0.2)},
        {"inputs": {"f": np.ones(1)}},
        {"parameters": {"k": 3.0}},
    ],
    ids=str,
)
def test_what_is_asked_differently_is_called(over: dict[str, Any]) -> None:
    stepped(Slow(), [1.0])
    again = Slow()
    stepped(again, [1.0], **over)
    assert again.calls == 1


def test_failures_are_counted_among_kept_results_too() -> None:
    said = []
    for _ in range(2):
        program = SteppedProgram(Slow(), Grid(()))
        given: dict[str, Any] = {"t": np.zeros(2), "dt": np.full(2, 0.1), "inputs": {}}
        given["parameters"] = {"k": 2.0}
        program.step(np.array([[1.0], [99.0]]), **given)
        said.append(program.failure)
    assert said[0] == said[1] and str(said[0]).startswith("1 of 2 steps failed")


def test_another_program_finds_nothing() -> None:
    stepped(Slow(), [1.0])
    other = Slow("b")
    stepped(other, [1.0])
    assert other.calls > 1


def test_cheap_calls_failures_and_what_shall_not_be_kept_are_not_kept(own_state_folder) -> None:
    for adapter, keep in ((Slow(seconds=0.0), True), (Slow(), False)):
        stepped(adapter, [1.0], keep)
        again = Slow(seconds=adapter.seconds)
        stepped(again, [1.0], keep)
        assert again.calls > 1
    stepped(Slow(), [1.0, 99.0])
    again = Slow()
    assert np.isnan(stepped(again, [1.0, 99.0])[1, 0])
    assert again.calls == 1


def test_the_file_is_bounded(monkeypatch: pytest.MonkeyPatch, own_state_folder: Path) -> None:
    kept = kept_results.KeptResults("a")
    monkeypatch.setattr(kept_results, "MOST_BYTES", 100_000)
    values = {bytes([i]): bytes(10_000) for i in range(40)}
    for key, value in values.items():
        kept._keep({key: value})
    left = [value is not None for value in kept._find(list(values))]
    assert 3 <= sum(left) <= 10 and left[-1] and not left[0]
    assert (own_state_folder / "programs.sqlite").stat().st_size < 200_000


def test_a_damaged_file_is_written_anew(own_state_folder: Path) -> None:
    stepped(Slow(), [1.0])
    (own_state_folder / "programs.sqlite").write_bytes(b"x" * 5000)
    again = Slow()
    np.testing.assert_allclose(stepped(again, [1.0]), 0.8)
    assert again.calls > 1
    third = Slow()
    stepped(third, [1.0])
    assert third.calls == 0
