"""The two regressions of the paper for missing physics in latent space."""

from __future__ import annotations

from collections.abc import Sequence

import torch
from jaxtyping import Float
from torch import Tensor

from dashred.inference.latent_sindy.blocks import Blocks
from dashred.inference.latent_sindy.sensor_encoding import HistoryEncoder
from dashred.inference.latent_sindy.step_sensitivities import RELATIVE_STEP, Step
from dashred.physics.system import System, Term
from dashred.physics.terms.library import evaluate_terms

# A step, or a term, changes the state by at most this multiple of the median, unless it blows up.
LOST = 1e6


def compressed_search(
    encoder: HistoryEncoder,
    fields: Float[Tensor, "time ..."],
    steps: Sequence[Step],
    columns: Sequence[Tensor],
    scales: Float[Tensor, " term"],
) -> Blocks:
    """Algorithm 1: regress the latent error of the simulator's forecasts on the candidates.

    ``E(û_t) - E(ũ⁰_t) ≈ Σ_j ξ_j ∂E(ũ_t)/∂ξ_j`` with ``ũ⁰_t = Φ_Δt(û_{t-Δt})``
    (Bao & Kutz 2025, Algorithm 1; docs/method.md#latent-sindy).

    Args:
        encoder: E, with the history of ``fields``.
        fields: û, ``(time, field, *grid)``.
        steps: the simulator's forecasts, one entry a step length.
        columns: derivatives of each forecast by the coefficients, ``(begin, term, field, *grid)``.
        scales: natural scale of each coefficient, for the finite differences.
    """
    targets, designs = [], []
    size = RELATIVE_STEP * scales
    for step, column in zip(steps, columns, strict=True):
        moves = size.reshape(-1, *(1,) * (column.dim() - 2)) * column
        base, moved = encoder.linearise(step.ends, step.forecast, moves)
        targets.append(encoder(step.ends, fields[step.ends]) - base)
        designs.append(moved / size[:, None])
    return stacked_blocks(targets, designs, size)


def compressed_advancing(
    encoder: HistoryEncoder,
    measured: Float[Tensor, "time latent"],
    system: System,
    library: Sequence[Term],
    fields: Float[Tensor, "time ..."],
    steps: Sequence[Step],
    duration: Float[Tensor, " step"],
    scales: Float[Tensor, " term"],
) -> Blocks:
    """Algorithm 2: regress the latent increment that the simulator does not explain.

    ``G_R(s'_{t+Δt}) - G_R(s'_t) - [E(Φ_Δt(û_t)) - E(û_t)] ≈ Σ_j ξ_j [E(û_t + θ_j Δt) - E(û_t)]``,
    where the perturbation acts only at the sensors (Bao & Kutz 2025, Algorithm 2; the paper prints
    a plus inside the increment). E reads only the sensors, so the limit of small neighbourhoods is
    taken: each reading changes by ``Δt`` times its derivative along θ_j.

    Args:
        encoder: E, with the history of ``fields``.
        measured: ``G_R(s')`` of the windows of the recording, ``(time, latent)``.
        system: the simulator.
        library: the candidates.
        fields: û, ``(time, field, *grid)``.
        steps: the simulator's forecasts, one entry a step length.
        duration: Δt of each entry of ``steps``, in units of time.
        scales: natural scale of each coefficient, for the finite differences.
    """
    targets, designs = [], []
    size = RELATIVE_STEP * scales
    for step, dt in zip(steps, duration.tolist(), strict=True):
        start = fields[step.begins]
        theta = evaluate_terms(system, library, start, float(step.time))
        moves = start.new_zeros(len(start), len(library), *start.shape[1:])
        for j, (term, h) in enumerate(zip(library, size.tolist(), strict=True)):
            moves[:, j, system.fields.index(term.equation)] = h * dt * theta[j]
        base, moved = encoder.linearise(step.begins, start, moves)
        simulated = encoder(step.ends, step.forecast) - base
        targets.append(measured[step.ends] - measured[step.begins] - simulated)
        designs.append(moved / size[:, None])
    return stacked_blocks(targets, designs, size)


def stacked_blocks(targets: list[Tensor], designs: list[Tensor], size: Tensor) -> Blocks:
    """Stack all step lengths, each in units of the rms of its target.

    The steps from one begin overlap. They form one block, which is left out and redrawn as a whole.
    A reconstructed field may lie where the simulator blows up. Blocks with such a step are dropped.
    A term under which most steps blow up, such as a high derivative that the solver does not
    resolve, gets a zero column and cannot be proposed.

    Args:
        targets: ``(block, latent)`` of each step length.
        designs: ``(block, term, latent)`` of each step length.
        size: of each coefficient, which makes the columns comparable, ``(term,)``.
    """
    designs = [_without_unstable_terms(design, size) for design in designs]
    usable = torch.ones(len(targets[0]), dtype=torch.bool)
    for target, design in zip(targets, designs, strict=True):
        for change in (target[:, None], design * size[:, None]):
            largest = change.norm(dim=-1).amax(dim=1)
            # Written with "<=", because the norms may be NaN.
            usable &= largest <= LOST * largest.nanmedian()
    targets, designs = ([part[usable] for part in parts] for parts in (targets, designs))
    weights = [1.0 / target.square().mean().sqrt().clamp(min=1e-300) for target in targets]
    target = torch.cat([t * w for t, w in zip(targets, weights, strict=True)], dim=-1)
    design = torch.cat([d * w for d, w in zip(designs, weights, strict=True)], dim=-1)
    return Blocks.from_arrays(target.numpy(), design.numpy())


def _without_unstable_terms(design: Tensor, size: Tensor) -> Tensor:
    """Return columns ``(block, term, latent)`` that are zero for terms that blow up."""
    changes = (design * size[:, None]).norm(dim=-1)
    # A change that is not finite is larger than all others.
    typical = changes.nan_to_num(nan=torch.inf, posinf=torch.inf).median(dim=0).values
    acting = typical[(typical > 0) & typical.isfinite()]
    if not len(acting):
        return design
    stable = typical <= LOST * acting.median()
    return torch.where(stable[:, None], design, 0.0)
