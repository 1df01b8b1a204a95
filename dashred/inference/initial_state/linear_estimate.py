"""The best linear unbiased estimate of a state from a sample of states and their readings."""

from __future__ import annotations

from dataclasses import dataclass

import torch
from jaxtyping import Float
from torch import Tensor

from dashred.inference.initial_state.start_models import LinearStart

# Modes this far below the strongest are rounding: centred anomalies are linearly dependent.
SMALLEST = 1e-6


@dataclass(frozen=True)
class Estimate:
    """A state estimate as a mean and a sample of what is left unknown.

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

    In the space of the members, with ``S = Y'ᵀR^{-1/2}/√(n−1)``, ``(member, reading)``: the
    weights are ``(I + SSᵀ)⁻¹ S R^{-1/2}(y − ȳ)`` and the anomalies ``(I + SSᵀ)^{-1/2} X'``, the
    symmetric square root, which alone keeps their sum zero (the ensemble transform; Hunt et al.,
    Physica D 230, 2007). Other than the filter it takes a window's readings at once, from
    continuations that are simulated already.

    Args:
        states: the sample.
        readings: of its members over the window, without noise.
        values: the recording's; NaN is missing.
        noise: σ of each sensor.
    """
    known = ~values.isnan()
    std = noise.expand_as(values)[known]
    read = readings[:, known]
    departure = (values[known] - read.mean(dim=0)) / std
    root = (len(states) - 1) ** 0.5
    scaled = (read - read.mean(dim=0)) / std / root
    mean = states.mean(dim=0)
    anomalies = states - mean
    # Eigenvalues of a Gram matrix may come out below zero by rounding.
    power, vectors = torch.linalg.eigh(scaled @ scaled.T)
    power = 1 + power.clamp(min=0)
    weights = (vectors / power) @ (vectors.T @ (scaled @ departure)) / root
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
        scale: a typical size of each field, so that none leads by its unit.
        count: how many modes at most; those of no variance are left out.
        inflation: factor on the modes: the estimate's own error bar is a little too small.
    """
    size = scale.reshape(-1, *(1,) * (estimate.mean.dim() - 1))
    scaled = (estimate.anomalies / size).flatten(1) / (len(estimate.anomalies) - 1) ** 0.5
    _, strengths, components = torch.linalg.svd(scaled, full_matrices=False)
    kept = int((strengths > SMALLEST * strengths[0]).sum())
    leading = slice(min(count, kept))
    modes = (strengths[leading, None] * components[leading]).reshape(-1, *estimate.mean.shape)
    return LinearStart(estimate.mean, inflation * modes * size)
