"""PDE-FIND: sparse regression on the full noisy field.

Rudy, Brunton, Proctor & Kutz, *Data-driven discovery of partial differential equations* (Science
Advances 3, 2017), by PySINDy, for what the simulator leaves out: ``∂u/∂t − N(u) = Σ ξ θ(u)``. It
uses the **full** field with noise, which no analysis has, so that only the scorer can run it. Its
time differences use the interval of the recording, which may be long; it is not an upper bound.
"""

from __future__ import annotations

import math
import warnings
from collections.abc import Sequence

import numpy as np
import torch
from numpy.typing import NDArray
from pysindy import STLSQ, FiniteDifference
from torch import Tensor

from dashred.evaluation.baselines.estimate import TermEntry
from dashred.physics.system import System, Term
from dashred.physics.terms.library import evaluate_terms

Array = NDArray[np.float64]

# Thresholds for columns and rates normalised to one.
THRESHOLDS = tuple(np.geomspace(1e-3, 1.0, 25))
RIDGE = 1e-4
# Share of the times that is fitted; the rest validates. The sparsest law whose error is within the
# tolerance of the best is chosen.
FIT_SHARE, TOLERANCE = 0.8, 1.01
MAX_ROWS = 20_000
# Samples dropped at both ends, where differences are one-sided.
ENDS = 2


def pde_find(
    system: System,
    library: Sequence[Term],
    times: Tensor,
    states: Tensor,
    noise: float,
    rng: np.random.Generator,
) -> list[TermEntry]:
    """Return the terms of the law.

    Args:
        system: the simulator.
        library: candidate terms.
        times: ``(time,)``.
        states: the true field, ``(time, field, *grid)``, without mirror images.
        noise: std of the added noise, as a share of that of each field.
        rng: random generator of the noise.
    """
    std = states.swapaxes(0, 1).flatten(1).std(dim=1).clamp(min=1e-300)
    scale = std.reshape(-1, *(1,) * (states.dim() - 2))
    noisy = states / scale + noise * torch.from_numpy(rng.standard_normal(states.shape))
    whole = scale * _smooth(system, noisy, noise)
    inner = slice(ENDS, len(times) - ENDS)
    rates = FiniteDifference(order=4, axis=0)._differentiate(whole.numpy(), times.numpy())[inner]
    return [
        entry
        for equation in dict.fromkeys(term.equation for term in library)
        for entry in _law_of(system, library, equation, times[inner], whole[inner], rates, rng)
    ]


def _smooth(system: System, noisy: Tensor, noise: float) -> Tensor:
    """Return denoised fields ``(time, field, *grid)`` with their mirror images.

    Uses a Wiener filter in space and a low-rank approximation in time.
    """
    whole = system.grid.ring(noisy)
    if system.axes:
        whole = wiener(whole, noise, system.grid.dims)
    return torch.from_numpy(low_rank(whole.flatten(1).numpy(), noise)).reshape(whole.shape)


def wiener(states: Tensor, noise: float, dims: tuple[int, ...]) -> Tensor:
    """Weight every wave by the share of its power that is not noise, ``max(0, 1 − σ²/P(k))``.

    P is averaged over all times. Without the filter, noise would dominate high derivatives.
    """
    spectrum = torch.fft.rfftn(states, dim=dims, norm="ortho")
    power = spectrum.abs().square().mean(dim=0)
    weights = (1 - noise**2 / power.clamp(min=1e-300)).clamp(min=0)
    sizes = [states.shape[dim] for dim in dims]
    return torch.fft.irfftn(spectrum * weights, s=sizes, dim=dims, norm="ortho")


def low_rank(snapshots: Array, noise: float) -> Array:
    """Return a low-rank approximation of snapshots ``(time, value)`` with noise of std ``noise``.

    Singular values are set to zero below the optimal threshold for a known noise (Gavish & Donoho,
    IEEE Trans. Inf. Theory 60, 2014, eq. 11).
    """
    short, long = sorted(snapshots.shape)
    beta = short / long
    root = math.sqrt(beta**2 + 14 * beta + 1)
    threshold = math.sqrt(2 * (beta + 1) + 8 * beta / (beta + 1 + root)) * math.sqrt(long) * noise
    left, values, right = np.linalg.svd(snapshots, full_matrices=False)
    return np.asarray((left * np.where(values > threshold, values, 0.0)) @ right)


def _law_of(
    system: System,
    library: Sequence[Term],
    equation: str,
    times: Tensor,
    states: Tensor,
    rates: Array,
    rng: np.random.Generator,
) -> list[TermEntry]:
    candidates = [term for term in library if term.equation == equation]
    known = Term(equation, system.equations[equation])
    columns = [
        evaluate_terms(system, [known, *candidates], state[None], time)[:, 0]
        for state, time in zip(states, times.tolist(), strict=True)
    ]
    by_time = _without_mirror_images(system, torch.stack(columns), 2)
    rate = torch.from_numpy(rates[:, system.fields.index(equation)])
    target = _without_mirror_images(system, rate, 1) - by_time[:, 0]
    design = by_time[:, 1:].swapaxes(1, 2)
    count = max(1, round(FIT_SHARE * len(times)))
    fitted = _rows(design[:count], target[:count], rng)
    validation = _rows(design[count:], target[count:], rng)
    coefficients = _sparse(*fitted, *validation)
    return [
        TermEntry(equation=equation, term=str(term), coefficient=float(value))
        for term, value in zip(candidates, coefficients, strict=True)
        if value != 0
    ]


def _without_mirror_images(system: System, values: Tensor, dims: int) -> Array:
    """Return values without mirror images, with space as one dimension after ``dims``."""
    return np.asarray(system.grid.own(values).reshape(*values.shape[:dims], -1).numpy())


def _rows(design: Array, target: Array, rng: np.random.Generator) -> tuple[Array, Array]:
    matrix, values = design.reshape(-1, design.shape[-1]), target.reshape(-1)
    if len(values) > MAX_ROWS:
        chosen = rng.choice(len(values), MAX_ROWS, replace=False)
        matrix, values = matrix[chosen], values[chosen]
    return matrix, values


def _sparse(matrix: Array, target: Array, validation_matrix: Array, validation: Array) -> Array:
    """Return the sparsest coefficients with a validation error close to the best."""
    size = np.linalg.norm(matrix, axis=0).clip(min=1e-300)
    rate = float(np.linalg.norm(target)) or 1.0
    tried = [np.zeros(matrix.shape[1])]
    with warnings.catch_warnings():
        # PySINDy warns when every term falls below the threshold.
        warnings.simplefilter("ignore")
        for threshold in THRESHOLDS:
            method = STLSQ(threshold=threshold, alpha=RIDGE)
            found = method.fit(matrix / size, target[:, None] / rate)
            tried.append(found.coef_[0] * rate / size)
    errors = [float(np.sqrt(np.mean((validation_matrix @ c - validation) ** 2))) for c in tried]
    good = [c for c, error in zip(tried, errors, strict=True) if error <= TOLERANCE * min(errors)]
    return np.asarray(min(good, key=np.count_nonzero))
