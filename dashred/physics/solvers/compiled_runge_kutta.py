"""Integrate batches of an ODE system with fixed steps, in compiled code."""

from __future__ import annotations

import copy
from collections.abc import Callable, Sequence
from typing import Any

import numba
import numpy as np
import torch
from numpy.typing import NDArray
from torch import Tensor

from dashred.physics.backends.numba_backend import KERNEL, REAL, Array, ChannelTerm, compile_kernel
from dashred.physics.forcing_basis import SampledForcing
from dashred.physics.runge_kutta import Tableau
from dashred.physics.solvers.batch_coefficients import CoefficientLayout
from dashred.physics.solvers.compiled_step import find_interval
from dashred.physics.solvers.forcing import Forcing
from dashred.physics.solvers.schedule import schedule
from dashred.physics.system import System, Term
from dashred.physics.window import Shape

Progress = Callable[[float], None]


class CompiledRungeKutta:
    """The same trajectories as :func:`dashred.physics.solvers.simulate.simulate` with fixed steps.

    Worth its second of compilation where many runs are made of one system.

    Args:
        system: an ODE system whose method has a tableau.
        terms: whatever a trajectory may carry, lets and parameters resolved.
        shapes: of the windows in which it may carry them.
    """

    def __init__(
        self, system: System, terms: Sequence[Term], shapes: tuple[Shape, ...] = ()
    ) -> None:
        assert system.tableau is not None
        self.system, self.tableau = system, system.tableau
        columns = CoefficientLayout(len(terms), shapes)
        channel = {field: i for i, field in enumerate(system.fields)}
        bodies = [ChannelTerm(channel[f], expr, None) for f, expr in system.resolved.items()]
        bodies += [
            ChannelTerm(channel[term.equation], term.expression, j, columns.windowed(j))
            for j, term in enumerate(terms)
        ]
        self.kernel = compile_kernel(
            bodies, list(system.fields), [], columns.factors(), system.input_signals
        )

    def with_step(self, dt: float) -> CompiledRungeKutta:
        """Return the same with another time step, nothing compiled again."""
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
            weights: coefficient of every term, ``(batch, term)``; with windows, as
                :class:`dashred.physics.solvers.batch_coefficients.CoefficientLayout` lays them out.
            sampled_forcing: a free forcing of every trajectory.
        """
        if sampled_forcing is None:
            sampled_forcing = SampledForcing(
                torch.zeros(0).double(), torch.zeros((len(start), 0, 0)).double()
            )
        steps = list(schedule(times.tolist(), self.system.dt))
        saved = np.empty((len(times), start.shape[1], len(start), 1))
        saved[0, :, :, 0] = start.numpy().T
        _integrate(
            self.kernel,
            saved,
            np.array([step.t for step in steps]),
            np.array([step.h for step in steps]),
            np.array([step.ends for step in steps]),
            np.ascontiguousarray(weights.numpy()),
            sampled_forcing.knots.numpy(),
            sampled_forcing.values.permute(1, 2, 0).contiguous().numpy(),
            _square_matrix(self.tableau),
            np.array(self.tableau.b),
            np.array(self.tableau.c),
        )
        return torch.from_numpy(saved[..., 0]).permute(2, 0, 1).contiguous()


def integrate_runge_kutta(
    system: System,
    start: Tensor,
    times: Tensor,
    forcing: Forcing | None,
    progress: Progress | None,
) -> Tensor:
    """Return what :func:`.simulate.simulate` returns, compiled for this run."""
    if forcing is None:
        forcing = Forcing((), torch.zeros((len(start), 0), dtype=torch.float64))
    found = CompiledRungeKutta(system, forcing.terms)(start, times, forcing.coefficients)
    if progress is not None:
        progress(1.0)
    return found


@numba.njit(cache=True)
def _add_forcing(
    knots: Array, sampled_forcing: NDArray[np.float64], t: float, rates: NDArray[np.float64]
) -> None:
    """Add the free forcing at one time to rates ``(field, row, 1)``."""
    if len(knots):
        k, share = find_interval(knots, t)
        rates[:, :, 0] += (1 - share) * sampled_forcing[k] + share * sampled_forcing[k + 1]


def _square_matrix(tableau: Tableau) -> Array:
    """Return the shares a of a tableau, ``(stage, stage)``, zeros on and above the diagonal."""
    found = np.zeros((len(tableau.b), len(tableau.b)))
    for row, shares in zip(found, tableau.a, strict=True):
        row[: len(shares)] = shares
    return found


@numba.njit(cache=True)
def _add_stages(y: Array, h: float, shares: Array, count: int, rates: Array, out: Array) -> None:
    """Set ``out`` to ``y + h Σ_j shares_j rates_j`` over the first rates, ``(place,)`` each."""
    for place in range(len(out)):
        out[place] = y[place]
    for j in range(count):
        factor = h * shares[j]
        if factor != 0.0:
            for place in range(len(out)):
                out[place] += factor * rates[j, place]


@numba.njit(
    numba.void(
        numba.types.FunctionType(KERNEL),
        REAL[:, :, :, ::1],
        REAL[::1],
        REAL[::1],
        numba.boolean[::1],
        REAL[:, ::1],
        REAL[::1],
        REAL[:, :, ::1],
        REAL[:, ::1],
        REAL[::1],
        REAL[::1],
    ),
    cache=True,
)
def _integrate(
    kernel: Any,
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
    """Fill ``saved`` ``(time, field, row, 1)`` by the explicit method with tableau a, b, c.

    The free forcing is ``(knot, field, row)``.
    """
    nowhere = np.zeros((0, 1))
    y = saved[0].copy()
    at, rates = np.empty_like(y), np.empty((len(b), *y.shape))
    # The same memory, one number after the other.
    flat_y, flat_at, flat_rates = y.reshape(-1), at.reshape(-1), rates.reshape((len(b), y.size))
    output = 0
    for i in range(len(times)):
        t, h = times[i], steps[i]
        for stage in range(len(b)):
            now = t + c[stage] * h
            _add_stages(flat_y, h, a[stage], stage, flat_rates, flat_at)
            kernel(at, nowhere, now, weights, rates[stage])
            _add_forcing(knots, sampled_forcing, now, rates[stage])
        _add_stages(flat_y, h, b, len(b), flat_rates, flat_y)
        if ends[i]:
            output += 1
            saved[output] = y
