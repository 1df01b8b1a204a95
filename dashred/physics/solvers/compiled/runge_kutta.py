"""Integrate batches of an ODE system with fixed steps, in compiled code."""

from __future__ import annotations

import copy
from collections.abc import Callable, Sequence

import numba
import numpy as np
import torch
from numpy.typing import NDArray
from torch import Tensor

from dashred.physics.backends.knot_intervals import find_interval
from dashred.physics.forcing_basis import SampledForcing
from dashred.physics.solvers.batch_coefficients import CoefficientLayout
from dashred.physics.solvers.forcing import Forcing
from dashred.physics.solvers.ode_rates import NO_COLUMN, Array, OdeRates, build_rates, set_rates
from dashred.physics.solvers.schedule import schedule
from dashred.physics.system import System, Term
from dashred.physics.window import Shape

Progress = Callable[[float], None]


class CompiledRungeKutta:
    """An ODE system with fixed steps, for many runs in compiled code.

    The compiled code is the same for all systems. The trajectories are those of
    :func:`.simulate.simulate`.

    Args:
        system: an ODE system whose method has a tableau.
        terms: all terms that a trajectory may have, with lets and parameters resolved.
        shapes: the possible factors of the windows of these terms.
    """

    def __init__(
        self, system: System, terms: Sequence[Term], shapes: tuple[Shape, ...] = ()
    ) -> None:
        assert system.tableau is not None
        self.system, self.tableau = system, system.tableau
        self.rates = build_rates(system, terms, CoefficientLayout(len(terms), shapes))
        self._method = tuple(map(np.array, (self.tableau.square, self.tableau.b, self.tableau.c)))

    def with_step(self, dt: float) -> CompiledRungeKutta:
        """Return a copy with another time step."""
        other = copy.copy(self)
        other.system = self.system.with_step(dt)
        return other

    def __call__(
        self,
        start: Tensor,
        times: Tensor,
        weights: Tensor,
        sampled_forcing: SampledForcing | None = None,
    ) -> Tensor:
        """Return trajectories ``(batch, time, field)``.

        Args:
            start: ``(batch, field)`` at ``times[0]``.
            times: output times, ``(time,)``.
            weights: coefficients of the terms, ``(batch, column)``, in the order of
                :class:`dashred.physics.solvers.batch_coefficients.CoefficientLayout`.
            sampled_forcing: free forcing of each trajectory.
        """
        if sampled_forcing is None:
            sampled_forcing = SampledForcing(
                torch.zeros(0).double(), torch.zeros((len(start), 0, 0)).double()
            )
        steps = list(schedule(times.tolist(), self.system.dt, self.system.jumps))
        saved = np.empty((len(times), start.shape[1], len(start)))
        saved[0] = start.numpy().T
        by_row = np.ascontiguousarray(weights.numpy())
        _integrate(
            self.rates,
            self._used(by_row),
            saved,
            np.array([step.t for step in steps], dtype=np.float64),
            np.array([step.h for step in steps], dtype=np.float64),
            np.array([step.ends for step in steps], dtype=np.bool_),
            by_row,
            sampled_forcing.knots.numpy(),
            sampled_forcing.values.permute(1, 2, 0).contiguous().numpy(),
            *self._method,
        )
        return torch.from_numpy(saved).permute(2, 0, 1).contiguous()

    def flow(
        self, weights: Tensor, sampled_forcing: SampledForcing | None
    ) -> Callable[[Tensor, float, float], Tensor]:
        """Return a single step of trajectories with these weights and forcings.

        It maps states ``(batch, field)``, time and step to states, and costs little more than the
        step itself. The arguments are those of :meth:`__call__`.
        """
        by_row = np.ascontiguousarray(weights.numpy())
        used, ends = self._used(by_row), np.array([True])
        knots, values = np.zeros(0), np.zeros((0, 0, len(by_row)))
        if sampled_forcing is not None:
            knots = sampled_forcing.knots.numpy()
            values = sampled_forcing.values.permute(1, 2, 0).contiguous().numpy()

        def step(state: Tensor, t: float, h: float) -> Tensor:
            saved = np.empty((2, state.shape[1], len(state)))
            saved[0] = state.numpy().T
            when = np.array([t]), np.array([h])
            parts = self.rates, used, saved, *when, ends, by_row, knots, values
            _integrate(*parts, *self._method)
            return torch.from_numpy(np.ascontiguousarray(saved[1].T))

        return step

    def leap(self, weights: Tensor, span: float) -> Callable[[Array, float], Array]:
        """Return the flow over one span, for many calls with the same weights.

        It maps states ``(batch, field)`` and the time at which they are to states.
        """
        by_row = np.ascontiguousarray(weights.numpy())
        steps = list(schedule([0.0, span], self.system.dt))
        after = np.array([step.t for step in steps])
        lengths = np.array([step.h for step in steps])
        ends = np.array([step.ends for step in steps])
        used, knots, values = self._used(by_row), np.zeros(0), np.zeros((0, 0, len(by_row)))

        def run(state: Array, begin: float) -> Array:
            saved = np.empty((2, state.shape[1], len(state)))
            saved[0] = state.T
            parts = self.rates, used, saved, begin + after, lengths, ends, by_row, knots, values
            _integrate(*parts, *self._method)
            return np.ascontiguousarray(saved[1].T)

        return run

    def _used(self, weights: Array) -> NDArray[np.int64]:
        """Return the indices of the functions with a weight in any row."""
        has_weight = np.append((weights != 0).any(axis=0), False)
        everywhere, inside = self.rates.places[:, 1], self.rates.places[:, 2]
        own = everywhere == NO_COLUMN
        return np.flatnonzero(own | has_weight[everywhere] | has_weight[inside])


def integrate_runge_kutta(
    system: System,
    start: Tensor,
    times: Tensor,
    forcing: Forcing | None,
    progress: Progress | None,
    sampled_forcing: SampledForcing | None,
) -> Tensor:
    """Run the system once and return what :func:`.simulate.simulate` returns."""
    if forcing is None:
        forcing = Forcing((), torch.zeros((len(start), 0), dtype=torch.float64))
    if progress is not None:
        progress(0.0)
    run = CompiledRungeKutta(system, forcing.terms)
    result = run(start, times, forcing.coefficients, sampled_forcing)
    if progress is not None:
        progress(1.0)
    return result


@numba.njit(cache=True)
def _add_forcing(
    knots: Array, sampled_forcing: NDArray[np.float64], t: float, rates: Array
) -> None:
    """Add the free forcing at one time to rates ``(field, row)``."""
    if len(knots):
        k, share = find_interval(knots, t)
        rates += (1 - share) * sampled_forcing[k] + share * sampled_forcing[k + 1]


@numba.njit(cache=True)
def _add_stages(y: Array, h: float, shares: Array, count: int, rates: Array, out: Array) -> None:
    """Set ``out`` to ``y + h Σ_{j<count} shares_j rates_j``, ``(place,)`` each."""
    for place in range(len(out)):
        out[place] = y[place]
    for j in range(count):
        factor = h * shares[j]
        if factor != 0.0:
            for place in range(len(out)):
                out[place] += factor * rates[j, place]


@numba.njit(cache=True, error_model="numpy")
def _integrate(
    functions: OdeRates,
    used: NDArray[np.int64],
    saved: NDArray[np.float64],
    times: Array,
    steps: Array,
    ends: NDArray[np.bool_],
    weights: Array,
    knots: Array,
    sampled_forcing: NDArray[np.float64],
    a: Array,
    b: Array,
    c: Array,
) -> None:
    """Integrate with the tableau a, b, c and fill ``saved``, ``(time, field, row)``.

    The free forcing is ``(knot, field, row)``.
    """
    y = saved[0].copy()
    at, rates = np.empty_like(y), np.empty((len(b), *y.shape))
    # One-dimensional views of the same memory.
    flat_y, flat_at, flat_rates = y.reshape(-1), at.reshape(-1), rates.reshape((len(b), y.size))
    output = 0
    for i in range(len(times)):
        t, h = times[i], steps[i]
        for stage in range(len(b)):
            now = t + c[stage] * h
            _add_stages(flat_y, h, a[stage], stage, flat_rates, flat_at)
            set_rates(functions, used, at, now, weights, rates[stage])
            _add_forcing(knots, sampled_forcing, now, rates[stage])
        _add_stages(flat_y, h, b, len(b), flat_rates, flat_y)
        if ends[i]:
            output += 1
            saved[output] = y
