"""The POD of states on disk, by passes over parts of them."""

from __future__ import annotations

import math
from collections.abc import Callable

import torch
from jaxtyping import Float
from torch import Tensor

from dashred.models.pod import LARGEST_GRAM, POD, leading_eigenvectors, oriented, subset
from dashred.physics.runs.stored_states import BLOCK_BYTES, States, StoredStates, blocks

# Bytes of the states whose products with all others are computed in one pass.
GROUP_BYTES = 2**29


def fit_pod(states: States, modes: int) -> POD:
    """Return the POD of states ``(member, time, field, *grid)``, in memory or on disk.

    On disk it has the same modes as in memory, up to rounding errors: :meth:`.pod.POD.fit`.
    """
    if isinstance(states, Tensor):
        return POD.fit(states.flatten(0, 1), modes)
    scale, mean = _scale_and_mean(states)
    samples = math.prod(states.shape[:2])
    chosen = subset(samples, len(mean))

    def anomalies(rows: Tensor) -> Tensor:
        members, times = rows // states.shape[1], rows % states.shape[1]
        found = states[members, times].flatten(2).div_(scale[:, None])
        return found.flatten(1).sub_(mean)

    if len(chosen) < len(mean):
        basis, energy = _modes_of_samples(anomalies, chosen, len(mean), modes)
    else:
        basis, energy = _modes_of_cells(anomalies, chosen, len(mean), modes)
    return POD(mean, basis, scale, energy, tuple(states.shape[3:]))


def _scale_and_mean(states: StoredStates) -> tuple[Tensor, Tensor]:
    """Return the std of each field, and the mean of the scaled states, ``(cell,)``.

    The means and squares of two parts are joined without cancellation (Chan, Golub & LeVeque 1983).
    """
    fields = states.shape[2]
    count, mean, squares = 0, torch.zeros(fields).double(), torch.zeros(fields).double()
    total = torch.zeros(states.shape[2:]).double()
    for block in blocks(states):
        flat = block.states.flatten(0, 1)
        total += flat.sum(dim=0)
        values = flat.transpose(0, 1).flatten(1)
        new, own = values.shape[1], values.mean(dim=1)
        distance = own - mean
        squares += (values - own[:, None]).square().sum(dim=1)
        squares += distance.square() * (count * new / (count + new))
        mean += distance * (new / (count + new))
        count += new
    scale = (squares / count).sqrt()
    scale = torch.where(scale > 0, scale, torch.ones_like(scale))
    mean_of_cells = total.flatten(1) / math.prod(states.shape[:2]) / scale[:, None]
    return scale, mean_of_cells.flatten()


def _modes_of_samples(
    anomalies: Callable[[Tensor], Tensor], chosen: Tensor, cells: int, count: int
) -> tuple[Float[Tensor, "mode cell"], Float[Tensor, " mode"]]:
    """Return the modes from the Gram matrix of the samples."""
    gram = torch.empty((len(chosen), len(chosen)), dtype=torch.float64)
    group, part = max(1, GROUP_BYTES // (8 * cells)), max(1, BLOCK_BYTES // (8 * cells))
    for first in range(0, len(chosen), group):
        own = anomalies(chosen[first : first + group])
        rows = slice(first, first + len(own))
        gram[rows, rows] = own @ own.T
        for begin in range(0, first, part):
            columns = slice(begin, min(begin + part, first))
            gram[rows, columns] = own @ anomalies(chosen[columns]).T
            gram[columns, rows] = gram[rows, columns].T
    vectors, eigenvalues = leading_eigenvectors(gram, count)
    weights = vectors / eigenvalues.sqrt()
    modes = torch.zeros((cells, weights.shape[1]), dtype=torch.float64)
    for begin in range(0, len(chosen), part):
        columns = slice(begin, begin + part)
        modes.addmm_(anomalies(chosen[columns]).T, weights[columns])
    return oriented(torch.linalg.qr(modes).Q), eigenvalues / gram.diagonal().sum()


def _modes_of_cells(
    anomalies: Callable[[Tensor], Tensor], chosen: Tensor, cells: int, count: int
) -> tuple[Float[Tensor, "mode cell"], Float[Tensor, " mode"]]:
    """Return the modes from the Gram matrix of the cells, of which there are few."""
    assert cells <= LARGEST_GRAM or len(chosen) == cells
    gram, part = torch.zeros((cells, cells)).double(), max(1, BLOCK_BYTES // (8 * cells))
    for begin in range(0, len(chosen), part):
        own = anomalies(chosen[begin : begin + part])
        gram.addmm_(own.T, own)
    modes, eigenvalues = leading_eigenvectors(gram, count)
    return oriented(modes), eigenvalues / gram.diagonal().sum()
