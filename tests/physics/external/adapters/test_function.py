"""A function as a program: how it is called, and what is said when it breaks the rules."""

from __future__ import annotations

import time
from collections.abc import Callable
from typing import Any

import numpy as np
import pytest
import torch

from dashred.core.errors import InputError
from dashred.physics.external.adapters.function import FunctionAdapter, run_as_step
from dashred.physics.external.stepped import SteppedProgram
from dashred.physics.grids.grid import Axis, Grid

NAME, PLACE = "mypkg.step", "mine.yaml:7"


def opened(function: Callable[..., Any], *fields: str) -> SteppedProgram:
    return SteppedProgram(
        FunctionAdapter(function, fields or ("u",), NAME, PLACE), Grid(()), keep=False
    )


def stepped(program: SteppedProgram, states: np.ndarray, **over: Any) -> np.ndarray:
    """Step states from different times, with steps of 0.1."""
    t, dt = np.arange(float(len(states))), np.full(len(states), 0.1)
    given: dict[str, Any] = {"t": t, "dt": dt, "inputs": {}, "parameters": {"k": 2.0}} | over
    return program.step(states, **given)


def decay(state, t, dt, inputs, parameters):
    """``du/dt = -k u``, in one step of Euler; one state or many."""
    return {"u": state["u"] - dt * parameters["k"] * state["u"]}


def shift(state, t, dt, inputs, parameters):
    """``du/dt = -du/dx``: ``np.roll`` without an axis mixes the states of a batch."""
    return {"u": state["u"] - dt * (state["u"] - np.roll(state["u"], 1))}


def test_a_function_of_arrays_takes_all_states_in_one_call() -> None:
    calls = []

    def step(state, t, dt, inputs, parameters):
        calls.append(np.shape(state["u"]))
        return decay(state, t, dt, inputs, parameters)

    program = opened(step)
    states = 1 + np.arange(20.0).reshape(5, 1, 4)
    dt = np.linspace(0.1, 0.3, 5)
    found = stepped(program, states, dt=dt)
    np.testing.assert_allclose(found, states * (1 - 2 * dt.reshape(-1, 1, 1)), rtol=1e-14)
    assert calls[-2:] == [(5, 4), (4,)]  # the last is a check of one state
    assert program.conduct.way.arrays and program.rounding < 1e-15


def test_no_function_is_called_for_a_step_of_no_length() -> None:
    def step(state, t, dt, inputs, parameters):
        assert np.min(dt) > 0
        return decay(state, t, dt, inputs, parameters)

    states, dt = np.array([[1.0], [2.0], [3.0]]), np.array([0.0, 0.1, 0.0])
    found = stepped(opened(step), states, dt=dt)
    np.testing.assert_allclose(found[:, 0], [1.0, 1.6, 3.0])


def test_a_function_of_one_state_is_called_for_each() -> None:
    program = opened(shift)
    states = np.random.default_rng(0).normal(size=(3, 1, 6))
    expected = 0.9 * states + 0.1 * np.roll(states, 1, axis=2)
    np.testing.assert_allclose(stepped(program, states), expected, rtol=1e-14)
    assert not program.conduct.many


def test_states_with_equal_steps_go_together_if_time_must_be_a_number() -> None:
    calls = []

    def step(state, t, dt, inputs, parameters):
        calls.append(np.shape(state["u"]))
        return {"u": state["u"] * float(np.exp(-dt))}

    program = opened(step)
    dt = np.array([0.1, 0.2, 0.1, 0.1])
    found = stepped(program, np.ones((4, 1, 3)), dt=dt)
    np.testing.assert_allclose(found[:, 0, 0], np.exp(-dt), rtol=1e-14)
    assert not program.conduct.reads_time and calls[-3:-1] == [(3, 3), (1, 3)]


def test_states_at_different_times_are_separate_if_the_time_is_read() -> None:
    def step(state, t, dt, inputs, parameters):
        return {"u": state["u"] + (dt if t > 1.5 else 0.0)}

    program = opened(step)
    found = stepped(program, np.ones((4, 1, 3)))
    np.testing.assert_allclose(found[:, 0, 0], [1, 1, 1.1, 1.1])
    assert program.conduct.reads_time and program.conduct.many


def test_time_that_is_read_in_some_states_only_is_right() -> None:
    def step(state, t, dt, inputs, parameters):
        late = state["u"] + float(t) if np.max(state["u"]) > 5 else state["u"]
        return {"u": late * float(dt)}

    states = np.array([1.0, 2.0, 9.0]).reshape(3, 1, 1) * np.ones((3, 1, 2))
    program = opened(step)
    stepped(program, states[:2])
    assert program.conduct.many and not program.conduct.reads_time
    np.testing.assert_allclose(stepped(program, states)[:, 0, 0], [0.1, 0.2, 1.1])


def test_states_that_are_mixed_by_some_batches_only_are_separated() -> None:
    def step(state, t, dt, inputs, parameters):
        substeps = int(np.ceil(np.abs(state["u"]).max() / 2))
        return {"u": state["u"] * (1 - dt / substeps) ** substeps}

    states = np.array([1.0, 1.5, 9.0]).reshape(3, 1, 1) * np.ones((3, 1, 2))
    program = opened(step)
    alone = np.concatenate([stepped(opened(step), states[[i]]) for i in range(3)])
    stepped(program, states[:2])
    assert program.conduct.many
    found = stepped(program, states[::-1])
    np.testing.assert_allclose(found, alone[::-1], rtol=1e-14)
    assert not program.conduct.many


def test_an_ode_of_plain_numbers_and_its_inputs() -> None:
    import math

    def step(state, t, dt, inputs, parameters):
        return {"x": state["x"] + dt * math.cos(t) * inputs["f"], "v": float(state["v"])}

    states = np.array([[0.0, 1.0], [2.0, 3.0]])
    found = stepped(opened(step, "x", "v"), states, inputs={"f": np.array([1.0, 3.0])})
    np.testing.assert_allclose(found, [[0.1, 1], [2 + 0.3 * np.cos(1), 3]])


def test_torch_and_its_single_precision_are_seen() -> None:
    def step(state, t, dt, inputs, parameters):
        u = torch.as_tensor(state["u"], dtype=torch.float32).requires_grad_()
        return {"u": u * (1 - torch.as_tensor(dt, dtype=torch.float32))}

    program = opened(step)
    found = stepped(program, np.ones((2, 1, 4)))
    np.testing.assert_allclose(found, 0.9, rtol=1e-6)
    assert 1e-8 < program.rounding < 2e-7


@pytest.mark.parametrize("digits", [5, 8, 11])
def test_digits_of_a_result_are_seen(digits: int) -> None:
    def step(state, t, dt, inputs, parameters):
        return {"u": state["u"] + dt * np.sin(state["v"]), "v": round(state["v"] * 0.9, digits)}

    program = opened(step, "u", "v")
    stepped(program, np.array([[1.0, 1.5]]))
    assert 0.1 < program.rounding * 10**digits < 1


def test_a_function_of_whole_runs_is_stepped() -> None:
    def run(start, times, inputs, parameters):
        decays = np.exp(-parameters["k"] * (np.asarray(times) - times[0]))
        return {"u": [start["u"] * factor for factor in decays]}

    program = opened(run_as_step(run, ("u",)))
    states = 1 + np.arange(6.0).reshape(2, 1, 3)
    np.testing.assert_allclose(stepped(program, states), states * np.exp(-0.2), rtol=1e-14)


def test_jax_compiles_for_few_sizes_of_a_batch() -> None:
    class Traced(np.ndarray):
        __module__ = "jaxlib._jax"

    sizes = set()

    def step(state, t, dt, inputs, parameters):
        sizes.add(np.shape(state["u"]))
        return {"u": (state["u"] * (1 - dt)).view(Traced)}

    program = opened(step)
    for members in (3, 5, 6, 7, 8):
        states = 1 + np.random.default_rng(members).random((members, 1, 4))
        np.testing.assert_allclose(stepped(program, states), 0.9 * states, rtol=1e-14)
    assert sizes == {(4,), (2, 4), (4, 4), (8, 4)}


def test_seconds_of_a_call_are_measured() -> None:
    def step(state, t, dt, inputs, parameters):
        time.sleep(0.02)
        return state

    program = opened(step)
    stepped(program, np.ones((1, 1, 2)))
    assert 0.02 <= program.seconds < 0.2


def in_place(state, t, dt, inputs, parameters):
    state["u"] *= 0.9
    return state


def counted() -> Callable[..., Any]:
    calls: list[int] = []

    def step(state, t, dt, inputs, parameters):
        calls.append(1)
        return {"u": state["u"] + len(calls)}

    return step


def broken(state, t, dt, inputs, parameters):
    return {"u": state["w"]}


FAULTS: dict[str, tuple[Callable[..., Any], str]] = {
    "in place": (in_place, "changes its argument: the array of u\n  copy it first"),
    "memory": (
        counted(),
        "returns results that differ by 2 for the same state\n  a state must hold all",
    ),
    "raises": (broken, r"fails: KeyError: 'w' \(.*test_function.py:\d+\)"),
    "exits": (lambda *_: exit(3), "fails: SystemExit: 3"),
    "arguments": (lambda state: state, "fails: TypeError: .*takes 1 positional argument"),
    "no field": (lambda *_: {"w": 1}, "returns no field u, but w"),
    "array": (
        lambda s, *_: s["u"],
        "returns ndarray, not a dictionary of fields\n  return {'u': …}",
    ),
    "shape": (
        lambda s, *_: {"u": s["u"][:-1]},
        r"returns u with the shape \(3,\) instead of \(4,\)",
    ),
    "complex": (lambda s, *_: {"u": 1j * s["u"]}, "returns u as complex128"),
    "text": (lambda s, *_: {"u": "a"}, "returns u as <U1, not as real numbers"),
    "no dt": (
        lambda s, *_: {"u": 0.9 * s["u"]},
        "steps by 0.2 of the state in one step of 0.1, but",
    ),
    "units": (lambda s, *_: {"u": np.rad2deg(s["u"])}, "steps by .* does it step by dt"),
    "no state": (lambda s, *_: {"u": np.ones(4)}, "returns the same for different states"),
    "NaN": (
        lambda s, *_: {"u": s["u"] * np.nan},
        "returns values of u that are not finite, at t = 0",
    ),
}


@pytest.mark.parametrize("fault", FAULTS)
def test_a_function_that_breaks_the_rules_is_refused(fault: str) -> None:
    function, said = FAULTS[fault]
    with pytest.raises(InputError, match=f"(?s){PLACE}: {NAME} {said}"):
        stepped(opened(function), np.ones((2, 1, 4)))


def test_a_state_that_fails_later_is_nan_and_the_others_stay() -> None:
    def step(state, t, dt, inputs, parameters):
        if np.any(state["u"] > 50):
            raise OverflowError("too fast")
        return {"u": state["u"] * np.exp(dt)}

    program = opened(step)
    states = np.array([2.0, 100.0, 1.0]).reshape(3, 1, 1)
    stepped(program, states[:1])
    found = stepped(program, states)[:, 0, 0]
    np.testing.assert_allclose(found, np.exp(0.1) * np.array([2, np.nan, 1]))
    assert program.failure is not None and "OverflowError: too fast (" in program.failure

    calm = opened(lambda s, t, dt, *_: {"u": np.where(s["u"] > 9, np.inf, s["u"] * (1 + dt))})
    stepped(calm, np.ones((1, 1, 2)))
    found = stepped(calm, np.array([[[1.0, 1.0]], [[1.0, 1e9]]]))
    np.testing.assert_array_equal(np.isnan(found[:, 0]), [[False, False], [True, True]])
    says = f"1 of 3 steps failed, the last one: {NAME} returns values that are not finite, at t = 1"
    assert calm.failure == says
    # A trajectory that is lost stays so: that is no further failure.
    stepped(calm, np.full((1, 1, 2), np.nan))
    assert calm.failure == says
    calm.forget_failures()
    assert calm.failure is None


@pytest.mark.parametrize("times", [1, 3])
def test_a_run_at_other_times_is_refused(times: int) -> None:
    def run(start, *_):
        return {"u": [start["u"]] * times}

    with pytest.raises(InputError, match=f"returns u at {times} times instead of 2"):
        stepped(opened(run_as_step(run, ("u",))), np.ones((1, 1, 2)))


def test_a_program_does_not_see_the_mirror_image_of_an_axis() -> None:
    seen = []

    def step(state, t, dt, inputs, parameters):
        seen.append(state["u"].shape[-1])
        return decay(state, t, dt, inputs, parameters)

    grid = Grid((Axis("x", 1.0, 4, "insulated"),))
    program = SteppedProgram(FunctionAdapter(step, ("u",), NAME, PLACE), grid, keep=False)
    own = torch.arange(10.0, dtype=torch.float64).reshape(2, 1, 5)
    found = stepped(program, grid.ring(own).numpy())
    np.testing.assert_allclose(found, 0.8 * grid.ring(own).numpy())
    assert set(seen) == {5}
