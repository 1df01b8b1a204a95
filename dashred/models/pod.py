"""Proper orthogonal decomposition of a system's states, all fields together."""

from __future__ import annotations

import torch
from jaxtyping import Float
from torch import Tensor, nn

# Eigenvalues below this part of the largest are rounding errors of the Gram matrix.
ROUNDING = 1e-13


class POD(nn.Module):
    """v = scale · (mean + Σ_i a_i φ_i), with orthonormal modes φ of the scaled states.

    Each field is divided by its own standard deviation, so that fields of different units count
    alike (Lumley 1967; method of snapshots: Sirovich 1987).

    Attributes:
        mean: (field*grid,), of the scaled states.
        modes: (r, field*grid), orthonormal, the most energetic first.
        scale: (field,), in the unit of each field.
        energy: (r,), share of the variance that each mode carries.
        grid: points along each axis.
    """

    mean: Tensor
    modes: Tensor
    scale: Tensor
    energy: Tensor

    def __init__(
        self,
        mean: Float[Tensor, " cell"],
        modes: Float[Tensor, "mode cell"],
        scale: Float[Tensor, " field"],
        energy: Float[Tensor, " mode"],
        grid: tuple[int, ...],
    ) -> None:
        """Keep a given basis."""
        super().__init__()
        self.grid = grid
        self.register_buffer("mean", mean)
        self.register_buffer("modes", modes)
        self.register_buffer("scale", scale)
        self.register_buffer("energy", energy)

    @classmethod
    def fit(cls, states: Float[Tensor, "sample field *grid"], modes: int) -> POD:
        """Find at most ``modes`` modes of training states; fewer if they span fewer directions.

        Raises:
            ValueError: if the states do not differ from each other.
        """
        samples, fields = states.shape[:2]
        scale = states.transpose(0, 1).reshape(fields, -1).std(dim=1, correction=0)
        scale = torch.where(scale > 0, scale, torch.ones_like(scale))
        scaled = (states.reshape(samples, fields, -1) / scale[:, None]).reshape(samples, -1)
        mean = scaled.mean(dim=0)
        basis, energy = _principal(scaled - mean, modes)
        return cls(mean, basis, scale, energy, tuple(states.shape[2:]))

    def encode(self, states: Float[Tensor, "*dims"]) -> Float[Tensor, "*batch mode"]:
        """Coefficients of states (*batch, field, *grid), in the dtype of the states."""
        dtype = states.dtype
        batch = states.shape[: states.ndim - 1 - len(self.grid)]
        fields = states.reshape(*batch, len(self.scale), -1) / self.scale.to(dtype)[:, None]
        return (fields.reshape(*batch, -1) - self.mean.to(dtype)) @ self.modes.to(dtype).T

    def decode(self, coefficients: Float[Tensor, "*batch mode"]) -> Float[Tensor, "*dims"]:
        """States (*batch, field, *grid) of coefficients, in their dtype."""
        dtype = coefficients.dtype
        cells = coefficients @ self.modes.to(dtype) + self.mean.to(dtype)
        batch = coefficients.shape[:-1]
        fields = cells.reshape(*batch, len(self.scale), -1) * self.scale.to(dtype)[:, None]
        return fields.reshape(*batch, len(self.scale), *self.grid)


def _principal(
    anomalies: Float[Tensor, "sample cell"], count: int
) -> tuple[Float[Tensor, "mode cell"], Float[Tensor, " mode"]]:
    samples, cells = anomalies.shape
    # The smaller Gram matrix costs a fraction of the SVD, and modes need no more accuracy.
    gram = anomalies @ anomalies.T if samples < cells else anomalies.T @ anomalies
    eigenvalues, vectors = torch.linalg.eigh(gram)
    eigenvalues, vectors = eigenvalues.flip(0), vectors.flip(1)
    kept = min(count, int((eigenvalues > ROUNDING * eigenvalues[0]).sum()))
    if kept == 0:
        raise ValueError("the states do not differ: they have no modes")
    modes = vectors[:, :kept]
    if samples < cells:
        modes = torch.linalg.qr(anomalies.T @ (modes / eigenvalues[:kept].sqrt())).Q
    # An eigenvector's sign is arbitrary: let its largest entry be positive, on every machine.
    peaks = modes.gather(0, modes.abs().argmax(dim=0, keepdim=True))
    energy = eigenvalues[:kept] / gram.diagonal().sum()
    return (modes * peaks.sign()).T.contiguous(), energy
