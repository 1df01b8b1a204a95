"""Functions that tests hand over as programs; ``trust`` them by their names here."""

from __future__ import annotations

import time
from collections.abc import Mapping
from typing import Any

import numpy as np

STEP = 0.01


def oscillator(
    state: Mapping[str, Any], t: Any, dt: Any, inputs: Any, parameters: Mapping[str, float]
) -> dict[str, Any]:
    """``x'' = -k x``, exactly."""
    w = np.sqrt(parameters["k"])
    c, s = np.cos(w * dt), np.sin(w * dt)
    return {"x": c * state["x"] + s / w * state["v"], "v": c * state["v"] - w * s * state["x"]}


def heavy(
    state: Mapping[str, Any], t: Any, dt: Any, inputs: Any, parameters: Mapping[str, float]
) -> dict[str, Any]:
    """``x' = p/m``, ``p' = -k x``, exactly: an oscillator with its momentum."""
    k, m = parameters["k"], parameters["m"]
    own = {"x": state["x"], "v": state["p"] / m}
    moved = oscillator(own, t, dt, inputs, {"k": k / m})
    return {"x": moved["x"], "p": m * moved["v"]}


def chain(
    state: Mapping[str, Any], t: Any, dt: Any, inputs: Any, parameters: Mapping[str, float]
) -> dict[str, Any]:
    """``a' = -k a``, ``b' = k a``, exactly."""
    left = state["a"] * np.exp(-parameters["k"] * dt)
    return {"a": left, "b": state["b"] + state["a"] - left}


def pendulum(
    state: Mapping[str, Any], t: Any, dt: Any, inputs: Any, parameters: Mapping[str, float]
) -> dict[str, Any]:
    """``theta'' = -g sin(theta)``, in short steps of the classical Runge-Kutta method."""
    g, x = parameters["g"], np.stack([state["theta"], state["omega"]])
    count = int(np.ceil(np.max(dt) / STEP))
    h = dt / count

    def rate(x: Any) -> Any:
        return np.stack([x[1], -g * np.sin(x[0])])

    for _ in range(count):
        a = rate(x)
        b = rate(x + h / 2 * a)
        c = rate(x + h / 2 * b)
        d = rate(x + h * c)
        x = x + h / 6 * (a + 2 * b + 2 * c + d)
    return {"theta": x[0], "omega": x[1]}


def heat(
    state: Mapping[str, Any], t: Any, dt: Any, inputs: Any, parameters: Mapping[str, float]
) -> dict[str, Any]:
    """``u_t = kappa u_xx`` on a periodic axis of length 2π, exactly."""
    modes = np.fft.rfft(state["u"])
    k = np.arange(modes.shape[-1])
    modes = modes * np.exp(-parameters["kappa"] * k**2 * dt)
    return {"u": np.fft.irfft(modes, np.shape(state["u"])[-1])}


def string(
    state: Mapping[str, Any], t: Any, dt: Any, inputs: Any, parameters: Mapping[str, float]
) -> dict[str, Any]:
    """``u_t = v``, ``v_t = u_xx`` on a periodic axis of length 2π, exactly."""
    u, v = (np.fft.rfft(state[name]) for name in ("u", "v"))
    k = np.arange(u.shape[-1])
    c, s = np.cos(k * dt), np.sin(k * dt)
    after = {"u": c * u + dt * np.sinc(k * dt / np.pi) * v, "v": c * v - k * s * u}
    return {name: np.fft.irfft(modes, np.shape(state["u"])[-1]) for name, modes in after.items()}


def heat_of_singles(
    state: Mapping[str, Any], t: Any, dt: Any, inputs: Any, parameters: Mapping[str, float]
) -> dict[str, Any]:
    """Return :func:`heat` in single precision."""
    found = heat(state, t, dt, inputs, parameters)
    return {"u": found["u"].astype(np.float32)}


def pendulum_of_singles(
    state: Mapping[str, Any], t: Any, dt: Any, inputs: Any, parameters: Mapping[str, float]
) -> dict[str, Any]:
    """Return :func:`pendulum` in single precision, as JAX does without ``jax_enable_x64``."""
    given = {name: np.asarray(value, np.float32) for name, value in state.items()}
    single: dict[str, Any] = {"g": np.float32(parameters["g"])}
    found = pendulum(given, t, np.asarray(dt, np.float32), inputs, single)
    return {name: value.astype(np.float32) for name, value in found.items()}


def pendulum_without_data(
    state: Mapping[str, Any], t: Any, dt: Any, inputs: Any, parameters: Mapping[str, float]
) -> dict[str, Any]:
    """Return :func:`pendulum` until t = 2, and then fail."""
    if np.max(t) > 2:
        raise IndexError("no wind data after t = 2")
    return pendulum(state, t, dt, inputs, parameters)


def slow_pendulum(
    state: Mapping[str, Any], t: Any, dt: Any, inputs: Any, parameters: Mapping[str, float]
) -> dict[str, Any]:
    """Return :func:`pendulum` of one state after a while."""
    time.sleep(0.03)
    return pendulum({name: float(value) for name, value in state.items()}, t, dt, {}, parameters)


def swing(
    state: Mapping[str, Any], t: Any, dt: Any, inputs: Any, parameters: Mapping[str, float]
) -> dict[str, Any]:
    """``theta'' = -g sin(theta)``, in a step of the leapfrog method."""
    g, middle = parameters["g"], state["theta"] + dt / 2 * state["omega"]
    omega = state["omega"] - dt * g * np.sin(middle)
    return {"theta": middle + dt / 2 * omega, "omega": omega}


def swing_with_tangents(
    state: Mapping[str, Any], t: Any, dt: Any, inputs: Any, parameters: Mapping[str, float]
) -> dict[str, Any]:
    """Return :func:`swing`."""
    return swing(state, t, dt, inputs, parameters)


def swing_jvp(
    state: Mapping[str, Any],
    t: Any,
    dt: Any,
    inputs: Any,
    parameters: Mapping[str, float],
    tangent: Mapping[str, Any],
) -> tuple[dict[str, Any], dict[str, Any]]:
    """Return :func:`swing` and its tangent."""
    g, middle = parameters["g"], state["theta"] + dt / 2 * state["omega"]
    moved = tangent["theta"] + dt / 2 * tangent["omega"]
    omega = tangent["omega"] - dt * g * np.cos(middle) * moved
    after = swing(state, t, dt, inputs, parameters)
    return after, {"theta": moved + dt / 2 * omega, "omega": omega}


swing_with_tangents.jvp = swing_jvp  # type: ignore[attr-defined]
