"""A function that hangs loses the states at which it does, as a command does."""

from __future__ import annotations

import math
import signal
import threading
import time
from typing import Any

import numpy as np
import pytest

from dashred.core.errors import InputError
from dashred.physics.external.adapters.call_limit import OverrunError, time_limit
from dashred.physics.external.adapters.function import FunctionAdapter
from dashred.physics.external.adapters.patience import Patience
from dashred.physics.external.stepped import SteppedProgram
from dashred.physics.grids.grid import Grid

LIMIT = 0.2


def hang(state: Any, t: Any, dt: Any, inputs: Any, parameters: Any) -> Any:
    while True:
        try:
            time.sleep(0.01)
        except Exception:
            continue


def hang_later(state: Any, t: Any, dt: Any, inputs: Any, parameters: Any) -> Any:
    if np.max(t) > 0.5:
        hang(state, t, dt, inputs, parameters)
    return {"u": state["u"] * np.exp(-dt)}


def opened(function: Any) -> SteppedProgram:
    adapter = FunctionAdapter(function, ("u",), "mypkg.step", "mine.yaml:7", LIMIT)
    return SteppedProgram(adapter, Grid(()), keep=False)


def step(program: SteppedProgram, t: float) -> np.ndarray:
    return program.step(np.ones((1, 1)), np.array([t]), np.array([0.1]), {}, {})


def test_a_function_that_hangs_at_once_is_refused_with_its_place() -> None:
    begun = time.monotonic()
    with pytest.raises(InputError, match=r"mypkg.step has not ended after 0.2 s \(") as e:
        step(opened(hang), 0.0)
    assert LIMIT <= time.monotonic() - begun < 10
    assert "test_call_limit.py:" in e.value.what
    assert "time_limit" in str(e.value.hint) and e.value.where == "mine.yaml:7"


def test_a_state_at_which_a_function_hangs_is_lost_and_told() -> None:
    program = opened(hang_later)
    assert step(program, 0.0)[0, 0] == pytest.approx(np.exp(-0.1))
    for _ in range(2):
        assert np.isnan(step(program, 1.0))
    clock = np.array([0.0, 1.0]), np.full(2, 0.1)
    together = program.step(np.ones((2, 1)), *clock, {}, {})
    np.testing.assert_allclose(together[:, 0], [np.exp(-0.1), np.nan])
    assert str(program.failure).startswith("3 of 5 steps failed, the last one: mypkg.step has not")


def test_an_analysis_ends_if_nearly_all_states_are_lost() -> None:
    program = opened(hang_later)
    step(program, 0.0)
    lost = [step(program, t) for t in range(1, 10)]
    assert np.isnan(lost).all()
    with pytest.raises(InputError, match=r"fails in 10 of 11 steps; in the last one it has") as e:
        step(program, 10.0)
    assert "time_limit" in str(e.value.hint)


def test_the_longest_time_follows_from_the_first_call() -> None:
    patience = Patience(60.0)
    assert patience.of(7) == 60.0
    with patience.call(2) as longest:
        assert longest == 60.0
    patience.each = 0.5
    assert patience.of(3) == 70.0
    with pytest.raises(ValueError, match="within its time"), patience.call(1):
        raise ValueError("within its time")
    assert patience.of(1) == 60.0
    patience.limit = 1e-9
    with pytest.raises(OverrunError), patience.call(1):
        raise OverrunError
    assert patience.limit == 1e-9


def test_nobody_waits_again_for_a_program_that_is_much_faster_elsewhere(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    clock = iter([0.0, 60.0])
    monkeypatch.setattr("dashred.physics.external.adapters.patience.monotonic", lambda: next(clock))
    patience = Patience(60.0, each=0.05)
    with pytest.raises(OverrunError), patience.call(1):
        raise OverrunError
    assert patience.of(1) == 5.0


def test_a_program_keeps_the_time_that_it_has_needed_before(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    clock = iter([0.0, 0.001, 0.0, 20.0, 0.0, 60.0])
    monkeypatch.setattr("dashred.physics.external.adapters.patience.monotonic", lambda: next(clock))
    patience = Patience(60.0)
    for count in (1, 5):
        with patience.call(count):
            pass
    with pytest.raises(OverrunError), patience.call(1):
        raise OverrunError
    assert patience.of(1) == 8.0


def test_the_timer_of_the_caller_goes_on() -> None:
    before = signal.getsignal(signal.SIGALRM)
    with pytest.raises(OverrunError), time_limit(0.05):
        with time_limit(5.0):
            time.sleep(0.1)
        time.sleep(5.0)
    assert signal.getsignal(signal.SIGALRM) is before
    assert signal.getitimer(signal.ITIMER_REAL)[0] == 0


def test_a_limit_that_no_timer_takes_is_none() -> None:
    for seconds in (1e12, math.inf):
        with time_limit(seconds):
            assert signal.getitimer(signal.ITIMER_REAL)[0] > 1e6
    assert signal.getitimer(signal.ITIMER_REAL)[0] == 0


def test_another_thread_has_no_limit() -> None:
    found = []

    def work() -> None:
        with time_limit(0.01):
            time.sleep(0.05)
        found.append(True)

    thread = threading.Thread(target=work)
    thread.start()
    thread.join()
    assert found
