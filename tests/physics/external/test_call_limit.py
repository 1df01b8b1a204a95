"""A function that hangs ends with one message."""

from __future__ import annotations

import math
import signal
import threading
import time
from typing import Any

import numpy as np
import pytest

from dashred.core.errors import InputError
from dashred.physics.external.call_limit import OverrunError, time_limit
from dashred.physics.external.function import FunctionAdapter
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


def test_a_function_that_hangs_ends_with_its_place() -> None:
    begun = time.monotonic()
    with pytest.raises(
        InputError, match=r"mypkg.step takes more than 0.2 s to step a state \("
    ) as e:
        step(opened(hang), 0.0)
    assert LIMIT <= time.monotonic() - begun < 10
    assert "test_call_limit.py:" in e.value.what
    assert "time_limit" in str(e.value.hint) and e.value.where == "mine.yaml:7"


def test_a_function_that_hangs_later_ends_as_well() -> None:
    program = opened(hang_later)
    assert step(program, 0.0)[0, 0] == pytest.approx(np.exp(-0.1))
    with pytest.raises(InputError, match="takes more than"):
        step(program, 1.0)


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
