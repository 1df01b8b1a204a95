"""Integrate ODE systems with adaptive steps, using torchdiffeq."""

from __future__ import annotations

from collections.abc import Callable

from torch import Tensor
from torchdiffeq import odeint


def integrate_adaptive(
    tendency: Callable[[Tensor, float], Tensor],
    start: Tensor,
    times: Tensor,
    method: str,
    rtol: float,
    atol: float,
) -> Tensor:
    """Integrate with error tolerance ``atol + rtol·|y|`` over the whole batch.

    Args:
        tendency: ``(state, t)`` → ``(batch, field)``, per unit time.
        start: ``(batch, field)`` at ``times[0]``.
        times: output times ``(time,)``.
        method: one of torchdiffeq's adaptive methods.
        rtol: relative tolerance.
        atol: absolute tolerance.

    Returns:
        ``(time, batch, field)``.

    Raises:
        FloatingPointError: the solution blows up.
    """
    # Steps end at output times: the interpolant of an 8th-order method has a much lower order.
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
