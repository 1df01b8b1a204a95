"""The best linear unbiased estimate of a state, from a sample of states and readings."""

from __future__ import annotations

from dataclasses import dataclass

import torch
from jaxtyping import Float
from torch import Tensor

from dashred.inference.initial_state.start_models import LinearStart

# Modes below this share of the strongest are rounding errors: centred anomalies are dependent.
SMALLEST = 1e-6


@dataclass(frozen=True)
class Estimate:
    """A state estimate: a mean, and a sample of its error.

    Attributes:
        mean: ``(field, *grid)``.
        anomalies: ``(member, field, *grid)``; the covariance is ``AᵀA/(member − 1)``.
    """

    mean: Tensor
    anomalies: Tensor


def linear_estimate(
    states: Float[Tensor, "member field ..."],
    readings: Float[Tensor, "member time sensor"],
    values: Float[Tensor, "time sensor"],
    noise: Float[Tensor, " sensor"],
) -> Estimate:
    """Return ``E[u|y] = ū + C_uy (C_yy + R)⁻¹ (y − ȳ)`` with the sample's covariances.

    It is computed in the space of the members, with ``S = Y'ᵀR^{-1/2}/√(n−1)``,
    ``(member, reading)``. The weights are ``(I + SSᵀ)⁻¹ S R^{-1/2}(y − ȳ)`` and the anomalies are
    ``(I + SSᵀ)^{-1/2} X'``. Only the symmetric square root keeps the sum of the anomalies zero (the
    ensemble transform; Hunt et al., Physica D 230, 2007). Unlike the filter, the estimate uses all
    readings of the window at once and needs no further simulation.

    Args:
        states: the sample.
        readings: readings of the sample over the window, without noise.
        values: readings of the recording; NaN where missing.
        noise: σ of each sensor.
    """
    available = ~values.isnan()
    std = noise.expand_as(values)[available]
    read = readings[:, available]
    innovation = (values[available] - read.mean(dim=0)) / std
    root = (len(states) - 1) ** 0.5
    scaled = (read - read.mean(dim=0)) / std / root
    mean = states.mean(dim=0)
    anomalies = states - mean
    # Rounding may make eigenvalues of a Gram matrix negative.
    power, vectors = torch.linalg.eigh(scaled @ scaled.T)
    power = 1 + power.clamp(min=0)
    weights = (vectors / power) @ (vectors.T @ (scaled @ innovation)) / root
    transform = (vectors / power.sqrt()) @ vectors.T
    return Estimate(
        mean + torch.tensordot(weights, anomalies, dims=1),
        torch.tensordot(transform, anomalies, dims=1),
    )


def leading_modes(
    estimate: Estimate, scale: Float[Tensor, " field"], count: int, inflation: float
) -> LinearStart:
    """Return the estimate as ``m + B z`` with the anomalies' leading principal components.

    ``BᵀB`` is ``inflation²`` times the covariance, up to the components left out.

    Args:
        estimate: mean and anomalies.
        scale: typical size of each field, which makes fields with different units comparable.
        count: largest number of modes; modes without variance are left out.
        inflation: factor on the modes; the estimate itself is slightly overconfident.
    """
    # A field that never differs has no size.
    known = torch.where(scale > 0, scale, 1.0)
    size = known.reshape(-1, *(1,) * (estimate.mean.dim() - 1))
    scaled = (estimate.anomalies / size).flatten(1) / (len(estimate.anomalies) - 1) ** 0.5
    _, strengths, components = torch.linalg.svd(scaled, full_matrices=False)
    significant = int((strengths > SMALLEST * strengths[0]).sum())
    leading = slice(min(count, significant))
    modes = (strengths[leading, None] * components[leading]).reshape(-1, *estimate.mean.shape)
    return LinearStart(estimate.mean, inflation * modes * size)
