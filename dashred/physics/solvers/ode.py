"""ODE systems by torchdiffeq, fixed or adaptive."""

from __future__ import annotations

from collections.abc import Callable

import torch
from torch import Tensor
from torchdiffeq import odeint

FIXED = ("rk4", "midpoint", "euler")
ADAPTIVE = ("dopri5", "dopri8", "bosh3")


def integrate_fixed(
    tendency: Callable[[Tensor, float], Tensor],
    start: Tensor,
    times: Tensor,
    method: str,
    steps: Tensor,
) -> Tensor:
    """Solve on a given grid of steps that contains every output time.

    Args:
        tendency: ``(state, t)`` → ``(batch, field)``, per unit time.
        start: ``(batch, field)`` at ``times[0]``.
        times: output times ``(time,)``.
        method: one of :data:`FIXED`.
        steps: all step ends ``(step,)``, a superset of ``times``.

    Returns:
        ``(time, batch, field)``.
    """
    options = {"grid_constructor": lambda func, y0, t: steps}
    return odeint(lambda t, y: tendency(y, t.item()), start, times, method=method, options=options)


def integrate_adaptive(
    tendency: Callable[[Tensor, float], Tensor],
    start: Tensor,
    times: Tensor,
    method: str,
    rtol: float,
    atol: float,
) -> Tensor:
    """Solve with error control ``atol + rtol·|y|`` over the whole batch; see above for shapes.

    Raises:
        FloatingPointError: the solution leaves every bound.
    """
    # Steps end at every output time: an 8th-order method's interpolant is far from its order.
    options = {"step_t": times}
    try:
        return odeint(
            lambda t, y: tendency(y, t.item()),
            start,
            times,
            method=method,
            rtol=rtol,
            atol=atol,
            options=options,
        )
    except AssertionError as error:
        if "underflow" not in str(error) and "non-finite" not in str(error):
            raise
        raise FloatingPointError(str(error)) from None


def substeps(times: Tensor, dt: float) -> Tensor:
    """Return step ends that hit every output time with steps of at most ``dt``."""
    ends = [times[:1]]
    for begin, end in zip(times[:-1].tolist(), times[1:].tolist(), strict=True):
        count = max(1, round_up((end - begin) / dt))
        ends.append(torch.linspace(begin, end, count + 1, dtype=times.dtype)[1:])
    return torch.cat(ends)


def round_up(ratio: float) -> int:
    """Return the smallest whole number of steps, forgiving rounding: 15.0000001 → 15."""
    return int(-(-(ratio - 1e-6) // 1))
