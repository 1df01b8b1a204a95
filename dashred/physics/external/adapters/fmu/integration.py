"""Integration of an FMU for model exchange: its derivatives, with equal steps, and its events."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from dashred.physics.external.adapters.fmu.instance import Instance
from dashred.physics.external.state_batch import Array, ProgramError

# The step is halved until halving it changes the result by less than this share.
TOLERANCE = 1e-9
MOST_STEPS = 4096
# Bisections that find an event in a step.
BISECTIONS = 40


def longest_step(integrate: Callable[[int], Array], dt: float) -> float:
    """Return a step of the method of Runge and Kutta that is short enough.

    Args:
        integrate: returns the states after dt, in so many steps.
        dt: length of the step that the program makes.

    Raises:
        ProgramError: no step is.
    """
    steps, before = 1, integrate(1)
    while steps < MOST_STEPS:
        after = integrate(2 * steps)
        scale = np.maximum(np.abs(after), np.abs(after).max())
        if np.all(np.abs(after - before) <= TOLERANCE * scale):
            return dt / steps
        steps, before = 2 * steps, after
    hint = "shorten the time step, or use its own solver: system.simulator.interface: co-simulation"
    raise ProgramError(f"is too stiff for {MOST_STEPS} steps in {dt:g}", hint)


class Reached(NamedTuple):
    """States that a step has reached.

    Attributes:
        t: time.
        x: continuous states, after an event if there is one; NaN if they are not finite.
        is_event: whether there is one.
    """

    t: float
    x: Array
    is_event: bool


def runge_kutta(instance: Instance, x: Array, t: float, h: float) -> Array:
    """Return the continuous states after a step of the classical method."""
    k1 = instance.slopes(t, x)
    k2 = instance.slopes(t + h / 2, x + h / 2 * k1)
    k3 = instance.slopes(t + h / 2, x + h / 2 * k2)
    k4 = instance.slopes(t + h, x + h * k3)
    return x + h / 6 * (k1 + 2 * k2 + 2 * k3 + k4)


Step = Callable[[Instance, Array, float, float], Array]


def path(
    instance: Instance, x: Array, t: float, dt: float, steps: int, step: Step = runge_kutta
) -> Iterator[Reached]:
    """Yield the continuous states after each step.

    A step ends at an event that is found in it by bisection.

    Args:
        instance: the FMU, started at t with the states x.
        x: continuous states.
        t: time.
        dt: length of the whole.
        steps: number of steps.
        step: the method.

    Raises:
        ProgramError: the FMU fails.
    """
    end, longest = t + dt, dt / steps
    signs = instance.signs(t, x)
    while end - t > 1e-9 * longest:
        h = min(longest, end - t, instance.next_event - t)
        after = step(instance, x, t, h)
        if not np.isfinite(after).all():
            yield Reached(end, np.full_like(x, np.nan), is_event=False)
            return
        found = instance.signs(t + h, after)
        is_event = bool((found != signs).any())
        if is_event:
            h, after = _before_event(instance, x, t, h, signs)
        t += h
        x = instance.complete_step(t, after, is_event)
        signs = instance.signs(t, x) if is_event else found
        yield Reached(t, x, is_event or x is not after)


def _before_event(
    instance: Instance, x: Array, t: float, h: float, signs: NDArray[np.bool_]
) -> tuple[float, Array]:
    """Return the shortest step found that is beyond the event, and the states there."""
    before, beyond, after = 0.0, h, x
    for _ in range(BISECTIONS):
        middle = (before + beyond) / 2
        states = runge_kutta(instance, x, t, middle)
        if (instance.signs(t + middle, states) != signs).any():
            beyond, after = middle, states
        else:
            before = middle
        if math.isclose(before, beyond, rel_tol=1e-12):
            break
    return beyond, runge_kutta(instance, x, t, beyond) if after is x else after
