"""Regression of the simulator's errors along an assimilated field on the candidates."""

from __future__ import annotations

from collections.abc import Sequence

from jaxtyping import Float
from torch import Tensor

from dashred.inference.latent_sindy.algorithms import stacked_blocks
from dashred.inference.latent_sindy.blocks import Blocks
from dashred.inference.latent_sindy.step_sensitivities import RELATIVE_STEP, Step
from dashred.models.pod import POD


def field_regression(
    pod: POD,
    modes: int,
    fields: Float[Tensor, "time ..."],
    steps: Sequence[Step],
    columns: Sequence[Tensor],
    scales: Float[Tensor, " term"],
) -> Blocks:
    """Regress the error of the simulator's forecasts in the leading POD coefficients.

    ``P (û_{t+Δ} − Φ_Δ(û_t)) ≈ Σ_j ξ_j P ∂Φ_Δ/∂ξ_j``, with P the projection on the leading modes. It
    is Algorithm 1 of Bao & Kutz (2025) with POD coefficients in place of the latent state. The
    readings determine no more modes than there are sensors. In the others û has errors that terms
    with high derivatives would explain.

    Args:
        pod: basis of the fields.
        modes: number of modes of P; for a system without axes, P is the identity.
        fields: û, ``(time, field, *grid)``, float64.
        steps: the simulator's forecasts, one entry a step length.
        columns: derivatives of each forecast by the coefficients, ``(begin, term, field, *grid)``.
        scales: natural scale of each coefficient.
    """

    def projected(states: Tensor) -> Tensor:
        space = (1,) * len(pod.grid)
        scaled = states / pod.scale.to(states).reshape(-1, *space)
        cells = scaled.flatten(-1 - len(space))
        return cells @ pod.modes[:modes].to(states).T if pod.grid else cells

    targets = [projected(fields[step.ends] - step.forecast) for step in steps]
    return stacked_blocks(targets, [projected(c) for c in columns], RELATIVE_STEP * scales)
