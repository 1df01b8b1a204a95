"""Step a program and the terms that act beside it: Strang splitting.

With the flow P of the program, and the flow L of the added terms::

    u(t + h) = L_{h/2} P_h L_{h/2} u(t) + O(h³)

The method has second order in the step (Strang, SIAM J. Numer. Anal. 5, 1968). Between two steps
without an output, the halves of L are one step. Without added terms the program is run as it is.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from functools import lru_cache, partial
from typing import NamedTuple

import numpy as np
import torch
from torch import Tensor

from dashred.physics.expressions.algebra import ZERO
from dashred.physics.external.protocol import Array, Program
from dashred.physics.forcing_basis import SampledForcing
from dashred.physics.grids.transforms import modes_of, points_of
from dashred.physics.program_parameters import changed_parameters, parameter_slopes
from dashred.physics.runge_kutta import CLASSICAL, advance
from dashred.physics.solvers.compiled.runge_kutta import CompiledRungeKutta
from dashred.physics.solvers.etdrk4 import CACHE_SIZE
from dashred.physics.solvers.forcing import Forcing
from dashred.physics.solvers.rhs import GridTendency, SpectralTendency
from dashred.physics.solvers.schedule import Step
from dashred.physics.substeps import Substeps
from dashred.physics.system import System

Flow = Callable[[Tensor, float, float], Tensor]
# φ(z) is 1 + z/2 to rounding below this |z|.
SMALL = 1e-8


class AddedFlow:
    """The flow L of the terms beside a program: ``u' = Σ ξ θ(u) + f(x, t)``.

    Attributes:
        is_empty: whether there are neither terms nor a forcing.
        is_forcing_alone: whether there are no terms, so that L adds the same to every state.

    Args:
        system: its equations are what is added to the program.
        forcing: further terms, with coefficients for each trajectory.
        sampled_forcing: free forcing f of each trajectory.
    """

    def __init__(
        self,
        system: System,
        forcing: Forcing | None = None,
        sampled_forcing: SampledForcing | None = None,
    ) -> None:
        forcing = forcing and forcing.added()
        has_terms = any(expr != ZERO for expr in system.resolved.values()) or (
            forcing is not None and bool(forcing.coefficients.any())
        )
        self.is_empty = not has_terms and sampled_forcing is None
        self.is_forcing_alone = not has_terms and sampled_forcing is not None
        parts = system, forcing, sampled_forcing
        self._advance = _spectral_step(*parts) if system.spectral else _explicit_step(*parts)

    def __call__(self, state: Tensor, t: float, h: float) -> Tensor:
        """Return the states at ``t + h``, ``(batch, field, *grid)``."""
        if self.is_empty:
            return state
        return self._advance(state, t, h)


def _spectral_step(
    system: System, forcing: Forcing | None, sampled_forcing: SampledForcing | None
) -> Flow:
    """Return the exponential midpoint rule, which is exact for the linear part.

    With ``û' = Lû + N(û, t)`` and ``φ(z) = (e^z - 1)/z`` (Hochbruck & Ostermann, Acta Numerica 19,
    2010)::

        a = e^(hL/2) û + h/2 φ(hL/2) N(û, t)        û(t + h) = e^(hL) û + h φ(hL) N(a, t + h/2)

    It has the order of the splitting.
    """
    tendency = SpectralTendency(system, forcing, torch.device("cpu"), sampled_forcing)
    grid = system.grid

    @lru_cache(CACHE_SIZE)
    def factors(h: float) -> tuple[Tensor, Tensor]:
        z = h * tendency.linear.to(torch.complex128)
        small = z.abs() < SMALL
        whole = torch.where(small, 1.0, z)
        return torch.exp(z), h * torch.where(small, 1 + z / 2, torch.expm1(whole) / whole)

    def advance_modes(state: Tensor, t: float, h: float) -> Tensor:
        # What the program puts into the highest modes is kept: the terms act on the others.
        low = tendency.dealias(modes_of(state, grid.shape))
        full, weight = factors(h)
        change = (full - 1) * low
        if not tendency.is_linear:
            full_half, weight_half = factors(h / 2)
            middle = full_half * low + weight_half * tendency(low, t)
            change = change + weight * tendency(middle, t + h / 2)
        return state + points_of(change, grid.shape)

    return advance_modes


def _explicit_step(
    system: System, forcing: Forcing | None, sampled_forcing: SampledForcing | None
) -> Flow:
    tableau = system.tableau or CLASSICAL
    if system.config.nodes is not None:
        return Substeps(tableau, GridTendency(system, forcing, sampled_forcing))
    if system.axes:
        return partial(advance, tableau, GridTendency(system, forcing, sampled_forcing))
    if forcing is None:
        forcing = Forcing((), torch.zeros((1, 0), dtype=torch.float64))
    return CompiledRungeKutta(system, forcing.terms).flow(forcing.coefficients, sampled_forcing)


class ProgramFlow:
    """The flow P of a system's program, with its parameters and inputs.

    Args:
        system: with a program.
        changes: of its parameters by name, one for all states or one for each, ``(1 | batch,)``.
    """

    def __init__(self, system: System, changes: Mapping[str, Tensor] | None = None) -> None:
        assert system.program is not None
        self.changes = {name: values.numpy() for name, values in (changes or {}).items()}
        self.program: Program = system.program
        self.parameters, self.signals = system.config.parameters, system.input_signals

    def __call__(self, state: Tensor, t: float, h: float) -> Tensor:
        """Return the states at ``t + h``, ``(batch, field, *grid)``."""
        if not self.changes:
            return torch.from_numpy(self._step(state.numpy(), t, h, self.parameters))
        table = np.stack([np.broadcast_to(c, len(state)) for c in self.changes.values()], axis=1)
        rows, group = np.unique(table, axis=0, return_inverse=True)
        found = torch.empty_like(state)
        for i, row in enumerate(rows):
            mine = torch.from_numpy(np.flatnonzero(group.reshape(-1) == i))
            changed = self._changed(row)
            found[mine] = torch.from_numpy(self._step(state[mine].numpy(), t, h, changed))
        return found

    def slopes(
        self, state: Tensor, after: Tensor, t: float, h: float, names: Sequence[str]
    ) -> Tensor:
        """Return the derivatives ``(name, field, *grid)`` of a step from a state by parameters.

        The states before and after the step are ``(field, *grid)``, and there is one change of each
        parameter.
        """
        found = parameter_slopes(
            lambda parameters: self._step(state[None].numpy(), t, h, parameters),
            after[None].numpy(),
            self._changed(np.array([c[0] for c in self.changes.values()])),
            names,
            self.program.rounding,
        )
        return torch.from_numpy(found[:, 0])

    def push(self, state: Tensor, directions: Tensor, t: float, h: float) -> tuple[Tensor, Tensor]:
        """Return the state after a step, and the tangents ``(row, field, *grid)`` of directions.

        The program offers tangents. The state is ``(field, *grid)``, and there is at least one
        direction, ``(row, field, *grid)``.
        """
        assert self.program.tangent is not None
        rows, each = state.expand_as(directions), np.ones(len(directions))
        joined = torch.cat([rows, directions], dim=1).numpy()
        parameters = self._changed(np.array([c[0] for c in self.changes.values()]))
        inputs = self.inputs(t * each, h * each)
        ends = self.program.tangent.step(joined, t * each, h * each, inputs, parameters)
        after, moved = torch.from_numpy(ends).chunk(2, dim=1)
        return after[0].clone(), moved

    def _step(self, states: Array, t: float, h: float, parameters: Mapping[str, float]) -> Array:
        each = np.ones(len(states))
        inputs = self.inputs(t * each, h * each)
        return self.program.step(states, t * each, h * each, inputs, parameters)

    def _changed(self, row: Array) -> dict[str, float]:
        """Return the parameters with the changes ``(name,)``."""
        return changed_parameters(
            self.parameters, dict(zip(self.changes, row.tolist(), strict=True))
        )

    def inputs(self, t: Array, h: Array) -> dict[str, Array]:
        """Return the inputs in the middle of each step, ``(batch,)`` each."""
        found = self.signals.at(t + h / 2)
        return {name: np.broadcast_to(value, t.shape).copy() for name, value in found.items()}


class SplitStep(NamedTuple):
    """One step of a program, and the steps of the added terms around it.

    Attributes:
        t: time at which the step begins.
        h: its length.
        before: time and length of the step of the added terms before it.
        after: of the one after it, if the state is an output then.
    """

    t: float
    h: float
    before: tuple[float, float]
    after: tuple[float, float] | None


def split_steps(steps: Iterable[Step]) -> Iterator[SplitStep]:
    """Yield the steps of the splitting: halves between which there is no output are one step."""
    waiting = 0.0
    for step in steps:
        half = step.h / 2
        before, after = (step.t - waiting, waiting + half), (step.t + half, half)
        waiting = 0.0 if step.ends else half
        yield SplitStep(step.t, step.h, before, after if step.ends else None)


def integrate_split(
    system: System,
    added: AddedFlow,
    start: Tensor,
    steps: Sequence[Step],
    changes: Mapping[str, Tensor] | None = None,
) -> Iterator[Tensor]:
    """Yield the states ``(batch, field, *grid)`` at the start and at every output time.

    Args:
        system: with the program.
        added: the flow of the terms beside it.
        start: ``(batch, field, *grid)``.
        steps: of the integration.
        changes: of the program's parameters by name, ``(batch,)`` each.
    """
    own, state = ProgramFlow(system, changes), start
    yield state
    for step in split_steps(steps):
        state = own(added(state, *step.before), step.t, step.h)
        if step.after is not None:
            state = added(state, *step.after)
            yield state
