"""Derivatives of a spectral trajectory with respect to its start and terms, on its device."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from functools import cache
from itertools import islice

import torch
from torch import Tensor

from dashred.physics.forcing_basis import ForcingBasis, SampledForcing
from dashred.physics.solvers.compiled.step import STAGES
from dashred.physics.solvers.etdrk4 import Coefficients
from dashred.physics.solvers.forcing import Forcing
from dashred.physics.solvers.schedule import schedule
from dashred.physics.solvers.simulate import tendency_on_device
from dashred.physics.system import System, Term
from dashred.physics.tangents.on_device.columns import Columns
from dashred.physics.tangents.on_device.reference_stages import ReferenceStages
from dashred.physics.tangents.on_device.stage_data import StageEvaluator
from dashred.physics.tangents.reference_trajectory import stage_times
from dashred.physics.tangents.semilinear_rhs import SemilinearTendency
from dashred.physics.tangents.sources import Sources
from dashred.physics.tangents.spectral_columns.equations import slopes_of

POINTS_AT_ONCE = 2**19
"""Stages times grid points whose slopes and sources are computed together."""
COLUMN_POINTS = 2**27
"""Columns times fields times grid points that are integrated together, to fit in the memory."""


@torch.no_grad()
def tangents_on_device(
    system: System,
    start: Tensor,
    directions: Tensor,
    times: Tensor,
    forcing: Forcing | None,
    sources: Sequence[tuple[Term, ...]],
    dtype: torch.dtype = torch.float64,
    sampled_forcing: SampledForcing | None = None,
    forcing_basis: ForcingBasis | None = None,
) -> Iterator[tuple[Tensor, Tensor]]:
    """Yield state and tangents at each output time, on the device of the system.

    The arguments, and up to rounding the values, are those of
    :func:`.tangent_linear.tangent_linear`: the derivative of ETDRK4, from ETDRK4 applied to
    ``δu' = Lδu + N'(u)δu + θ_k(u)``.

    Raises:
        NotSemilinearError: the system is not supported.
    """
    basis_count = 0 if forcing_basis is None else forcing_basis.count
    count = len(directions) + len(sources) + basis_count
    state = start[None].to(system.device)
    tangents = state.new_zeros((len(system.fields), count, *system.grid.shape), dtype=dtype)
    tangents[:, : len(directions)] = directions.transpose(0, 1).to(tangents)
    yield state[0], tangents.transpose(0, 1)
    tendency = SemilinearTendency(system, forcing, sampled_forcing)
    source_terms = Sources(system, sources, len(directions), forcing_basis)
    slopes = [slope for _, _, slope in slopes_of(tendency)]
    evaluate = StageEvaluator(system, tendency.inputs, slopes, source_terms, dtype)
    reference = ReferenceStages(tendency_on_device(system, forcing, sampled_forcing))
    coefficients = cache(lambda h: _for_columns(reference.coefficients(h), dtype.to_complex()))
    size = max(1, COLUMN_POINTS // start.numel())
    chunks = [range(i, min(i + size, count)) for i in range(0, count, size)]
    parts = [Columns(system, tendency, source_terms, chunk, dtype) for chunk in chunks]
    columns = [
        part.in_modes(tangents[:, c.start : c.stop]) for part, c in zip(parts, chunks, strict=True)
    ]
    modes = state
    steps = schedule(times.tolist(), system.dt, system.jumps)
    steps_at_once = max(1, POINTS_AT_ONCE // (STAGES * start[0].numel()))
    while block := list(islice(steps, steps_at_once)):
        state, modes, states, stages = reference.advance(block, state, modes)
        data = evaluate(stage_times(block), stages)
        ended = iter(states)
        for i, step in enumerate(block):
            own = coefficients(step.h)
            for k, part in enumerate(parts):
                if step.begins:
                    columns[k] = part.in_modes(part.on_grid(columns[k]))
                columns[k] = part.step(columns[k], own, data, STAGES * i)
            if step.ends:
                found = [part.on_grid(each) for part, each in zip(parts, columns, strict=True)]
                yield next(ended), torch.cat(found, dim=1).transpose(0, 1)


def _for_columns(coefficients: Coefficients, dtype: torch.dtype) -> Coefficients:
    """Return the coefficients for columns, ``(field, 1, *modes)`` each, in their precision."""
    return Coefficients(*(each[0][:, None].to(dtype) for each in coefficients))
