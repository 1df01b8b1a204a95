"""Proper orthogonal decomposition (POD) of a system's states, jointly for all fields."""

from __future__ import annotations

import torch
from jaxtyping import Float
from torch import Tensor, nn

# Eigenvalues below this share of the largest are rounding errors of the Gram matrix.
EIGENVALUE_TOLERANCE = 1e-13
# Largest Gram matrix. Its eigenvectors take seconds, and the time grows with the third power.
LARGEST_GRAM = 2048


class POD(nn.Module):
    """``v = scale · (mean + Σ_i a_i φ_i)``, with orthonormal modes φ of the scaled states.

    Each field is divided by its std, so that fields with different units have equal weight
    (Lumley 1967; method of snapshots: Sirovich 1987).

    Attributes:
        mean: of the scaled states, ``(field*grid,)``.
        modes: orthonormal, in order of decreasing energy, ``(r, field*grid)``.
        scale: in the unit of each field, ``(field,)``.
        energy: share of the variance in each mode, ``(r,)``.
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
        """Store a given basis."""
        super().__init__()
        self.grid = grid
        self.register_buffer("mean", mean)
        self.register_buffer("modes", modes)
        self.register_buffer("scale", scale)
        self.register_buffer("energy", energy)

    @classmethod
    def fit(cls, states: Float[Tensor, "sample field *grid"], modes: int) -> POD:
        """Compute at most ``modes`` modes of training states; fewer if the rank is lower.

        Of many samples of many cells, the modes are those of a random subset.

        Raises:
            ValueError: all states are equal.
        """
        samples, fields = states.shape[:2]
        scale = states.transpose(0, 1).reshape(fields, -1).std(dim=1, correction=0)
        scale = torch.where(scale > 0, scale, torch.ones_like(scale))
        scaled = (states.reshape(samples, fields, -1) / scale[:, None]).reshape(samples, -1)
        mean = scaled.mean(dim=0)
        chosen = subset(*scaled.shape)
        basis, energy = _principal_modes(scaled[chosen] - mean, modes)
        return cls(mean, basis, scale, energy, tuple(states.shape[2:]))

    def with_modes(self, modes: Float[Tensor, "mode cell"]) -> POD:
        """Return the basis with other modes that begin like its own.

        The energy of those beyond its own counts as zero.
        """
        kept = self.energy[: len(modes)]
        energy = torch.nn.functional.pad(kept, (0, len(modes) - len(kept)))
        return POD(self.mean, modes, self.scale, energy, self.grid)

    def encode(self, states: Float[Tensor, "*dims"]) -> Float[Tensor, "*batch mode"]:
        """Return the coefficients of states ``(*batch, field, *grid)``, in their dtype."""
        dtype = states.dtype
        batch = states.shape[: states.ndim - 1 - len(self.grid)]
        fields = states.reshape(*batch, len(self.scale), -1) / self.scale.to(dtype)[:, None]
        return (fields.reshape(*batch, -1) - self.mean.to(dtype)) @ self.modes.to(dtype).T

    def decode(self, coefficients: Float[Tensor, "*batch mode"]) -> Float[Tensor, "*dims"]:
        """Return the states ``(*batch, field, *grid)`` of coefficients, in their dtype."""
        dtype = coefficients.dtype
        cells = coefficients @ self.modes.to(dtype) + self.mean.to(dtype)
        batch = coefficients.shape[:-1]
        fields = cells.reshape(*batch, len(self.scale), -1) * self.scale.to(dtype)[:, None]
        return fields.reshape(*batch, len(self.scale), *self.grid)

    def left_out(self, states: Float[Tensor, "time field *grid"]) -> float:
        """Return the RMS of what the modes cannot express of states, in std of each field."""
        rest = (states - self.decode(self.encode(states))).transpose(0, 1).flatten(1)
        std = states.transpose(0, 1).flatten(1).std(dim=1, correction=0)
        varies = std > 0
        return float((rest[varies] / std[varies, None]).square().mean().sqrt())


def subset(samples: int, cells: int) -> Tensor:
    """Return the indices of the samples that give the modes, in order; the same in every run."""
    if min(samples, cells) <= LARGEST_GRAM:
        return torch.arange(samples)
    shuffled = torch.randperm(samples, generator=torch.Generator().manual_seed(0))
    return shuffled[:LARGEST_GRAM].sort().values


def _principal_modes(
    anomalies: Float[Tensor, "sample cell"], count: int
) -> tuple[Float[Tensor, "mode cell"], Float[Tensor, " mode"]]:
    samples, cells = anomalies.shape
    # The smaller Gram matrix is much cheaper than an SVD, and accurate enough for the modes.
    gram = anomalies @ anomalies.T if samples < cells else anomalies.T @ anomalies
    modes, eigenvalues = leading_eigenvectors(gram, count)
    if samples < cells:
        modes = torch.linalg.qr(anomalies.T @ (modes / eigenvalues.sqrt())).Q
    return oriented(modes), eigenvalues / gram.diagonal().sum()


def leading_eigenvectors(
    gram: Float[Tensor, "row row"], count: int
) -> tuple[Float[Tensor, "row mode"], Float[Tensor, " mode"]]:
    """Return at most ``count`` eigenvectors and eigenvalues of a Gram matrix, the largest first.

    Raises:
        ValueError: all states are equal.
    """
    eigenvalues, vectors = torch.linalg.eigh(gram)
    eigenvalues, vectors = eigenvalues.flip(0), vectors.flip(1)
    kept = min(count, int((eigenvalues > EIGENVALUE_TOLERANCE * eigenvalues[0]).sum()))
    if kept == 0:
        raise ValueError("all states are equal: they have no modes")
    return vectors[:, :kept], eigenvalues[:kept]


def oriented(modes: Float[Tensor, "cell mode"]) -> Float[Tensor, "mode cell"]:
    """Return the modes as rows, with signs that are the same on every machine."""
    # The sign of an eigenvector is arbitrary: make its largest entry positive.
    peaks = modes.gather(0, modes.abs().argmax(dim=0, keepdim=True))
    return (modes * peaks.sign()).T.contiguous()
