"""Whether the sensors can see the state: what a change of the start does to their readings."""

from __future__ import annotations

import time
from collections.abc import Iterator
from dataclasses import dataclass

import torch
from jaxtyping import Float
from torch import Tensor

from dashred.data.observation_operator import ObservationOperator
from dashred.physics.solvers.simulate import simulate
from dashred.physics.system import System
from dashred.physics.tangents.ode_tangents import supports_ode, tangent_ode
from dashred.physics.tangents.tangent_linear import supports, tangent_linear
from dashred.pipeline.check.context import CheckContext
from dashred.pipeline.check.remark import Remark, doubtful
from dashred.pipeline.check.simulator import Simulated

# Seconds for the tangents, and the most columns that are carried.
SECONDS, MOST = 2.0, 48
# Where equations have no tangents of their own, differences of this size stand for them.
DIFFERENCE = 1e-4
# What is left unknown of a field, as a share of its prior std: below the one it is seen well,
# above the other not at all.
WELL, HARDLY = 0.2, 0.9


@dataclass(frozen=True)
class Seen:
    """What sensors tell about a start ``u₀ = m + B z``, z ~ N(0, I).

    Attributes:
        sensitivity: ``J = ∂(readings/σ)/∂z``, ``(time·sensor, mode)``.
        modes: B, ``(mode, field, *grid)``.
        seconds: a column's for a sample.
        samples: of the record that J is over.
        of: how many modes the prior has; the strongest are looked at.
    """

    sensitivity: Float[Tensor, "reading mode"]
    modes: Float[Tensor, "mode field ..."]
    seconds: float
    samples: int
    of: int

    @property
    def singular_values(self) -> Tensor:
        """Of J: how many σ a mode of size 1 moves all readings together, ``(mode,)``."""
        return torch.linalg.svdvals(self.sensitivity)

    def unknown(self) -> Tensor:
        """Return ``√(tr BᵀPB / tr BᵀB)`` by field, ``(field,)``; NaN where B is 0.

        ``P = (I + JᵀJ)⁻¹`` is the covariance of z that the readings leave.
        """
        eye = torch.eye(len(self.modes), dtype=torch.float64)
        left = torch.linalg.inv(eye + self.sensitivity.T @ self.sensitivity)
        flat = self.modes.reshape(*self.modes.shape[:2], -1)
        prior = torch.einsum("kfx,kfx->f", flat, flat)
        posterior = torch.einsum("kfx,kl,lfx->f", flat, left, flat)
        return (posterior / prior).clamp(min=0).sqrt()


@torch.no_grad()
def look(situation: CheckContext, simulated: Simulated) -> Seen | None:
    """Carry the start's modes along the nominal run and read them; None without any spread."""
    prior = simulated.prior
    if not prior.size:
        return None
    count = min(prior.size, MOST)
    modes = _modes(simulated, count)
    operator = ObservationOperator(situation.sensors, situation.system)
    sigma = situation.sigma(simulated.states)
    began, rows = time.perf_counter(), []
    for state, moved in _tangents(situation.system, simulated, modes):
        rows.append(_read(operator, state, moved) / sigma)
        if time.perf_counter() - began > SECONDS and len(rows) > 1:
            break
    seconds = (time.perf_counter() - began) / (max(1, len(rows) - 1) * count)
    sensitivity = torch.cat([row.T for row in rows])
    return Seen(sensitivity, modes, seconds, len(rows), prior.size)


def about_observability(situation: CheckContext, seen: Seen | None) -> Iterator[Remark]:
    """Say in plain words what the sensors tell about the start."""
    if seen is None:
        hint = (
            "system.spread says how well the start is known; any error in it is taken for physics"
        )
        yield doubtful("The start is taken for exactly known: no spread is given", hint)
        return
    if not torch.isfinite(seen.sensitivity).all():
        yield doubtful("What the sensors see cannot be told: small changes of the start blow up")
        return
    end = float(situation.times[seen.samples - 1])
    visible = int((seen.singular_values >= 1).sum())
    count = len(seen.modes)
    strongest = f" (the strongest of {seen.of})" if count < seen.of else ""
    yield Remark(
        f"Until t = {end:.6g} the sensors feel {visible} of {count} ways in which the start may "
        f"differ{strongest} above their noise"
    )
    yield from _by_field(situation, seen)


def _by_field(situation: CheckContext, seen: Seen) -> Iterator[Remark]:
    read = {sensor.reads for sensor in situation.sensors}
    for field, left in zip(situation.system.fields, seen.unknown().tolist(), strict=True):
        by = "" if field in read else ", which no sensor reads itself,"
        if left != left:
            yield Remark(f"{field}{by} is taken to start exactly as given (no spread.{field})")
        elif left <= WELL:
            yield Remark(f"{field}{by} is seen: {1 - left:.0%} of what is not known of its start")
        elif left <= HARDLY:
            yield Remark(f"{field}{by} is seen in part: {left:.0%} of its start stays unknown")
        else:
            yield doubtful(
                f"{field}{by} is hardly seen: {left:.0%} of what is not known of its start stays "
                "unknown",
                f"laws in what moves {field} alone can be told by nothing: add a sensor that "
                "feels it, or say in system.spread how well its start is known",
            )


def _modes(simulated: Simulated, count: int) -> Tensor:
    """Return ``∂u₀/∂z`` of each field's strongest modes, ``(mode, field, *grid)``."""
    prior = simulated.prior
    eye = torch.eye(prior.size, dtype=torch.float64)
    base = prior.start(torch.zeros(1, prior.size, dtype=torch.float64))
    modes = (prior.start(DIFFERENCE * eye) - base) / DIFFERENCE
    size = modes.reshape(*modes.shape[:2], -1).norm(dim=2)
    size = size / size.amax(dim=0).clamp(min=1e-300)
    # Each field's own strongest, by turns: none is left out for the unit that it is in.
    rank = torch.zeros(len(modes), dtype=torch.float64)
    leading = size.argmax(dim=1)
    for field in range(size.shape[1]):
        mine = torch.nonzero(leading == field)[:, 0]
        order = mine[size[mine, field].argsort(descending=True, stable=True)]
        rank[order] = torch.arange(len(order), dtype=torch.float64)
    return modes[rank.argsort(stable=True)[:count]]


def _tangents(
    system: System, simulated: Simulated, modes: Tensor
) -> Iterator[tuple[Tensor, Tensor]]:
    """Yield the state, and what the modes have become, at every sample."""
    start, times = simulated.states[0], simulated.times
    if system.axes and supports(system, []):
        return tangent_linear(system, start, modes, times, None, [])
    if supports_ode(system, []):
        return tangent_ode(system, start, modes, times, None, [])
    return _differences(system, simulated, modes)


def _differences(
    system: System, simulated: Simulated, modes: Tensor
) -> Iterator[tuple[Tensor, Tensor]]:
    count = simulated.affordable(SECONDS, float(len(modes)))
    starts = torch.cat([simulated.states[:1], simulated.states[:1] + DIFFERENCE * modes])
    path = simulate(system, starts, simulated.times[:count]).transpose(0, 1)
    for states in path:
        yield states[0], (states[1:] - states[0]) / DIFFERENCE


def _read(operator: ObservationOperator, state: Tensor, moved: Tensor) -> Tensor:
    """Return ``H'(u)δu`` of every mode, ``(mode, sensor)``: lets need not be linear."""
    small = DIFFERENCE / moved.abs().flatten(1).max(dim=1).values.clamp(min=1e-12)
    small = small * state.abs().max().clamp(min=1e-12)
    steps = small.reshape(-1, *(1,) * (moved.dim() - 1))
    found: Tensor = operator(state + steps * moved) - operator(state[None])
    return found / small[:, None]
