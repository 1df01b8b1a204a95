"""Observability of the initial state: the sensitivity of the readings to it."""

from __future__ import annotations

import time
from collections.abc import Iterator
from dataclasses import dataclass

import torch
from jaxtyping import Float
from torch import Tensor

from dashred.data.observation_operator import ObservationOperator
from dashred.inference.forward.columns.states_along import states_along
from dashred.physics.solvers.simulate import simulate
from dashred.physics.system import System
from dashred.physics.tangents.cell_tangents import has_cell_tangents, tangent_cells
from dashred.physics.tangents.ode_tangents import has_ode_tangents, tangent_ode
from dashred.physics.tangents.program_tangents import tangent_program
from dashred.physics.tangents.tangent_linear import has_spectral_tangents, tangent_linear
from dashred.pipeline.check.context import CheckContext
from dashred.pipeline.check.remark import Remark, warning
from dashred.pipeline.check.simulator_checks.simulator import NominalRun

# Seconds for the tangent runs, and the largest number of modes.
SECONDS, MAX_MODES = 2.0, 48
# Step of the finite differences that replace tangents where the equations have none.
DIFFERENCE = 1e-4
# Posterior over prior standard deviation of a field: up to the first it is observed, beyond the
# second it is not.
OBSERVED, UNOBSERVED = 0.2, 0.9


@dataclass(frozen=True)
class Observability:
    """Linearised observations of a start ``u₀ = m + B z``, z ~ N(0, I).

    Attributes:
        sensitivity: ``J = ∂(readings/σ)/∂z``, ``(time·sensor, mode)``.
        modes: B, ``(mode, field, *grid)``.
        seconds: run time of one column over one sample.
        samples: number of samples in J.
        prior_size: number of modes of the prior; J has the strongest of them.
    """

    sensitivity: Float[Tensor, "reading mode"]
    modes: Float[Tensor, "mode field ..."]
    seconds: float
    samples: int
    prior_size: int

    @property
    def singular_values(self) -> Tensor:
        """Singular values of J, ``(mode,)``: change of the readings in σ per unit of a mode."""
        return torch.linalg.svdvals(self.sensitivity)

    def posterior_ratio(self) -> Tensor:
        """Return posterior over prior std, ``√(tr BᵀPB / tr BᵀB)``, ``(field,)``; NaN where B is 0.

        ``P = (I + JᵀJ)⁻¹`` is the posterior covariance of z.
        """
        # Chaos makes some entries of J so large that I + JᵀJ is singular in floating point.
        _, sizes, directions = torch.linalg.svd(torch.linalg.qr(self.sensitivity).R)
        known = torch.zeros(len(self.modes), dtype=torch.float64)
        known[: len(sizes)] = sizes
        covariance = (directions.T / (1 + known.square())) @ directions
        flat = self.modes.reshape(*self.modes.shape[:2], -1)
        prior = torch.einsum("kfx,kfx->f", flat, flat)
        posterior = torch.einsum("kfx,kl,lfx->f", flat, covariance, flat)
        return (posterior / prior).clamp(min=0).sqrt()


@torch.no_grad()
def linearised_observations(context: CheckContext, nominal: NominalRun) -> Observability | None:
    """Propagate the start's modes along the nominal run; return None without a spread."""
    prior = nominal.prior
    if not prior.size:
        return None
    count = min(prior.size, MAX_MODES)
    modes = _modes(nominal, count)
    operator = ObservationOperator(context.sensors, context.system)
    sigma = context.sigma(nominal.states)
    # The first step compiles the equations, which says nothing about the next.
    compiled = int(context.system.program is None and len(nominal.times) > 2)
    started, rows = time.perf_counter(), []
    spread = float(modes.abs().max())
    for state, tangents in _tangents(context.system, nominal, modes):
        [moved], [steps] = states_along(state[None], tangents[None], spread)
        derivative = (operator(moved) - operator(state[None])) / steps[:, None]
        rows.append(derivative / sigma)
        if len(rows) == 1 + compiled:
            started = time.perf_counter()
        elif len(rows) > 1 + compiled and time.perf_counter() - started > SECONDS:
            break
    seconds = (time.perf_counter() - started) / (max(1, len(rows) - 1 - compiled) * count)
    sensitivity = torch.cat([row.T for row in rows])
    return Observability(sensitivity, modes, seconds, len(rows), prior.size)


def observability_remarks(
    context: CheckContext, observed: Observability | None
) -> Iterator[Remark]:
    """Say how well the sensors determine the initial state."""
    if observed is None:
        hint = "give system.spread; otherwise errors of the initial state look like missing physics"
        yield warning("The initial state is assumed to be exact: no spread is given", hint)
        return
    if not torch.isfinite(observed.sensitivity).all():
        yield warning("Observability is unknown: small changes of the initial state blow up")
        return
    end = float(context.times[observed.samples - 1])
    visible = int((observed.singular_values >= 1).sum())
    count, size = len(observed.modes), observed.prior_size
    strongest = f" (the strongest of {size})" if count < size else ""
    part = ""
    if observed.samples < len(context.times):
        part = f" (the first {observed.samples} of {len(context.times)} samples)"
    yield Remark(
        f"Up to t = {end:.6g}{part} the sensors resolve {visible} of {count} modes of the initial "
        f"state{strongest} above their noise"
    )
    yield from _by_field(context, observed)


def _by_field(context: CheckContext, observed: Observability) -> Iterator[Remark]:
    read = {sensor.reads for sensor in context.sensors}
    for field, ratio in zip(
        context.system.fields, observed.posterior_ratio().tolist(), strict=True
    ):
        by = "" if field in read else " (not measured directly)"
        if ratio != ratio:
            yield Remark(
                f"{field}{by} is assumed to start exactly as given: there is no "
                f"system.spread.{field}"
            )
        elif ratio <= OBSERVED:
            yield Remark(f"{field}{by} is observed: {ratio:.0%} of its prior std remains")
        elif ratio <= UNOBSERVED:
            yield Remark(f"{field}{by} is partly observed: {ratio:.0%} of its prior std remains")
        elif field in read:
            yield Remark(
                f"{field}: system.spread determines its start better than its sensor alone does"
            )
        else:
            text = f"{field}{by} is not observed: {ratio:.0%} of its prior std remains"
            if observed.samples < len(context.times):
                yield Remark(f"{text}; later samples, which a run uses, may tell more")
                continue
            yield warning(
                text,
                f"no law in the equation of {field} alone can be found: add a sensor that depends "
                "on it, or decrease its system.spread",
            )


def _modes(nominal: NominalRun, count: int) -> Tensor:
    """Return ``∂u₀/∂z`` of each field's strongest modes, ``(mode, field, *grid)``."""
    prior = nominal.prior
    eye = torch.eye(prior.size, dtype=torch.float64)
    base = prior.start(torch.zeros(1, prior.size, dtype=torch.float64))
    modes = (prior.start(DIFFERENCE * eye) - base) / DIFFERENCE
    size = modes.reshape(*modes.shape[:2], -1).norm(dim=2)
    size = size / size.amax(dim=0).clamp(min=1e-300)
    # The strongest mode of each field in turn, so that units do not decide which fields are kept.
    rank = torch.zeros(len(modes), dtype=torch.float64)
    leading = size.argmax(dim=1)
    for field in range(size.shape[1]):
        own = torch.nonzero(leading == field)[:, 0]
        order = own[size[own, field].argsort(descending=True, stable=True)]
        rank[order] = torch.arange(len(order), dtype=torch.float64)
    return modes[rank.argsort(stable=True)[:count]]


def _tangents(
    system: System, nominal: NominalRun, modes: Tensor
) -> Iterator[tuple[Tensor, Tensor]]:
    """Yield the state and the propagated modes at every sample."""
    start, times = nominal.states[0], nominal.times
    if system.program is not None:
        return tangent_program(system, start, modes, times, None, [])
    if system.axes and has_spectral_tangents(system, []):
        return tangent_linear(system, start, modes, times, None, [])
    if has_ode_tangents(system, []):
        return tangent_ode(system, start, modes, times, None, [])
    if has_cell_tangents(system, []):
        return tangent_cells(system, start, modes, times, None, [])
    return _differences(system, nominal, modes)


def _differences(
    system: System, nominal: NominalRun, modes: Tensor
) -> Iterator[tuple[Tensor, Tensor]]:
    count = nominal.affordable_samples(SECONDS, float(len(modes)))
    starts = torch.cat([nominal.states[:1], nominal.states[:1] + DIFFERENCE * modes])
    path = simulate(system, starts, nominal.times[:count]).transpose(0, 1)
    for states in path:
        yield states[0], (states[1:] - states[0]) / DIFFERENCE
