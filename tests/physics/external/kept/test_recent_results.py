"""Results in memory: nothing that a program has just stepped is stepped again."""

from __future__ import annotations

import tracemalloc
from hashlib import blake2b
from typing import Any

import numpy as np
import pytest

from dashred.physics.external.adapters.function import FunctionAdapter
from dashred.physics.external.kept import recent_results
from dashred.physics.external.state_batch import StateBatch
from dashred.physics.external.stepped import SteppedProgram
from dashred.physics.grids.grid import Grid

PARAMETERS = {"k": 2.0}


class Decay:
    """``du/dt = -k u``, which counts its calls and states; it fails above 90."""

    def __init__(self) -> None:
        self.counts: list[int] = []

    def __call__(self, state: Any, t: Any, dt: Any, inputs: Any, parameters: Any) -> Any:
        """Step states."""
        self.counts.append(np.size(state["u"]))
        if np.max(state["u"]) > 90:
            raise ValueError("too large")
        return {"u": state["u"] * np.exp(-parameters["k"] * dt) + 0 * t}


def opened() -> tuple[Decay, SteppedProgram]:
    decay = Decay()
    program = SteppedProgram(
        FunctionAdapter(decay, ("u",), "my.step", "mine.yaml:7"), Grid(()), keep=False
    )
    stepped(program, [7.0])
    # The calls 1, 2, 4, 8, … are checked by single calls.
    program._calls = 4
    decay.counts.clear()
    return decay, program


def stepped(
    program: SteppedProgram, states: list[float], t: float = 0.0, **changed: float
) -> np.ndarray:
    each = np.ones(len(states))
    column = np.array(states)[:, None]
    return program.step(column, t * each, 0.1 * each, {}, PARAMETERS | changed)[:, 0]


def test_only_new_states_are_stepped() -> None:
    decay, program = opened()
    first = stepped(program, [1.0, 2.0])
    np.testing.assert_array_equal(stepped(program, [2.0, 1.0]), first[::-1])
    assert decay.counts == [2]
    np.testing.assert_array_equal(stepped(program, [1.0, 3.0, 2.0])[[0, 2]], first)
    assert decay.counts == [2, 1]
    stepped(program, [1.0], t=0.1)
    np.testing.assert_allclose(stepped(program, [1.0], k=3.0), np.exp(-0.3))
    assert decay.counts == [2, 1, 1, 1]
    # What is returned belongs to the caller.
    stepped(program, [1.0])[:] = 0.0
    assert stepped(program, [1.0])[0] == first[0]


def test_the_key_of_a_state_is_computed_once(monkeypatch: pytest.MonkeyPatch) -> None:
    count = 0

    def counted(*args: Any, **given: Any) -> Any:
        nonlocal count
        count += 1
        return blake2b(*args, **given)

    monkeypatch.setattr(recent_results, "blake2b", counted)
    _, program = opened()
    count = 0
    stepped(program, [1.0, 2.0])
    assert count == 2


def test_a_state_that_failed_is_not_tried_again() -> None:
    decay, program = opened()
    for _ in range(2):
        assert np.isnan(stepped(program, [95.0])).all()
    assert decay.counts == [1]
    assert str(program.failure).startswith("2 of 3 steps failed")


def test_the_oldest_are_forgotten(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(recent_results, "MOST_BYTES", 2 * (recent_results.ENTRY_BYTES + 8))
    decay, program = opened()
    for state in (1.0, 2.0, 3.0, 3.0, 2.0, 1.0):
        stepped(program, [state])
    assert decay.counts == [1, 1, 1, 1]


def test_their_memory_is_bounded_for_small_states_too(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(recent_results, "MOST_BYTES", 2**20)
    results, each = recent_results.RecentResults(), np.ones(5000)
    tracemalloc.start()
    for part in range(4):
        states = np.arange(15000.0).reshape(5000, 3) + part / 8
        results.keep(results.keys(StateBatch(states, each, each, {}, PARAMETERS)), states)
    used, _ = tracemalloc.get_traced_memory()
    tracemalloc.stop()
    assert used < 2 * 2**20
