"""Fit the latent transform and the adapter to states that are known."""

from __future__ import annotations

from collections.abc import Sequence

import torch
from jaxtyping import Float
from torch import Tensor, nn

from dashred.models.dynamics.adapter import AdaptedDecoder

# Iterations of L-BFGS at most, in parts, and the largest error of a field that ends it, in std.
ITERATIONS, AT_ONCE, TOLERANCE = 300, 50, 3e-4


def distil(
    transform: nn.Module,
    decoder: nn.Module,
    fitted: Sequence[nn.Parameter],
    latent: Float[Tensor, "time latent"],
    states: Float[Tensor, "time mode"],
    scale: Float[Tensor, " mode"],
) -> float:
    """Fit ``F(h + T(h)) + A(h + T(h))`` to states; return the RMS that is left.

    The last layer of the adapter A is solved for. If the states are not met by that, all weights
    are fitted by L-BFGS.

    Args:
        transform: h + T(h).
        decoder: F, with the adapter if there is one.
        fitted: weights of T and A.
        latent: h of all samples.
        states: POD coefficients in units of their std.
        scale: RMS of a field, in std, by which each coefficient changes it when it grows by one.
    """
    target = states.to(latent)
    weights = scale.to(latent)
    if isinstance(decoder, AdaptedDecoder):
        with torch.no_grad():
            decoder.solve(transform(latent), target)

    def loss() -> Tensor:
        error = (decoder(transform(latent)) - target) * weights
        return error.square().sum(dim=1).mean()

    optimizer = torch.optim.LBFGS(
        fitted,
        max_iter=AT_ONCE,
        history_size=100,
        line_search_fn="strong_wolfe",
        tolerance_grad=1e-12,
        tolerance_change=1e-14,
    )

    def closure() -> float:
        optimizer.zero_grad()
        value = loss()
        value.backward()
        return value.item()

    for _ in range(ITERATIONS // AT_ONCE):
        with torch.no_grad():
            left = float(loss().sqrt())
        if left <= TOLERANCE:
            break
        optimizer.step(closure)
    with torch.no_grad():
        return float(loss().sqrt())
