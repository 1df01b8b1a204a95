"""Simulate the members of an ensemble, a large one on the workers of a cluster if there is one.

The bits of a member depend neither on the number of workers nor on whether there is a cluster.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Sequence
from contextlib import suppress
from dataclasses import dataclass
from functools import cached_property

from torch import Tensor

from dashred.core.cluster.calls import ClusterCalls, cluster_in_use
from dashred.core.threads import in_threads
from dashred.core.work import add_work, count_trajectories, counted
from dashred.physics.expressions.semilinear import NotSemilinearError
from dashred.physics.solvers.compiled.etdrk4 import CompiledETDRK4
from dashred.physics.solvers.forcing import Forcing
from dashred.physics.solvers.schedule import count_steps
from dashred.physics.solvers.simulate import Progress, compilation_work, simulate
from dashred.physics.system import CPU, System, Term

# Members are simulated on a cluster if they take this many times as long as a compilation, because
# every worker compiles the system.
WORTHWHILE = 8
# Largest number of values that a call returns: 256 MiB.
MOST_VALUES = 2**25


def simulate_members(
    system: System,
    starts: Tensor,
    times: Tensor,
    forcing: Forcing,
    progress: Progress | None = None,
    rounds: float = 1.0,
) -> Tensor:
    """Return the trajectories of members, ``(member, time, field, *grid)``.

    Args:
        system: the simulator.
        starts: ``(member, field, *grid)`` at ``times[0]``.
        times: output times, ``(time,)``.
        forcing: additional terms with coefficients for each member.
        progress: called with the fraction done.
        rounds: expected number of such simulations; many are worth a compilation.

    Raises:
        InputError: the scheduler of the cluster is lost, or its workers die.
    """
    calls = cluster_in_use()
    if calls is not None and is_large(system, starts, times, forcing):
        # Other equations are not compiled.
        with suppress(NotSemilinearError, ArithmeticError):
            return _on_workers(calls, system, starts, times, forcing, progress)
    return simulate(system, starts, times, forcing, progress, repeats=rounds)


def is_large(system: System, starts: Tensor, times: Tensor, forcing: Forcing) -> bool:
    """Return whether members are simulated on a cluster if there is one."""
    if not system.spectral or system.program is not None or system.device != CPU:
        return False
    work = starts.numel() * count_steps(times.tolist(), system.dt)
    return len(starts) > 1 and work > WORTHWHILE * compilation_work(len(forcing.terms))


@dataclass(frozen=True)
class MemberSimulator:
    """A simulator that a worker keeps; it compiles it once.

    Attributes:
        system: the simulator.
        terms: the terms of all members.
    """

    system: System
    terms: Sequence[Term]

    @cached_property
    def _compiled(self) -> CompiledETDRK4:
        return CompiledETDRK4(self.system, self.terms)

    def run(
        self, starts: Tensor, times: Tensor, coefficients: Tensor, rows: slice
    ) -> tuple[Tensor, Counter[str]]:
        """Return the trajectories of some members, and the Fourier transforms that they took.

        The coefficients are those of all members.
        """
        with counted() as work:
            return self._compiled(starts, times, coefficients, rows=rows), work


def _on_workers(
    calls: ClusterCalls,
    system: System,
    starts: Tensor,
    times: Tensor,
    forcing: Forcing,
    progress: Progress | None,
) -> Tensor:
    members, simulator = len(starts), MemberSimulator(system, forcing.terms)
    count_trajectories(members, count_steps(times.tolist(), system.dt), starts[0].numel())
    least = -(-starts.numel() * len(times) // MOST_VALUES)
    groups = min(members, max(calls.count, least))
    edges = [round(i * members / groups) for i in range(groups + 1)]
    states = starts.new_empty((members, len(times), *starts.shape[1:]))

    def run(i: int) -> None:
        rows = slice(edges[i], edges[i + 1])
        states[rows], work = calls.call_with(
            (simulator,), MemberSimulator.run, starts[rows], times, forcing.coefficients, rows
        )
        add_work(work)

    for done in in_threads(run, groups, calls.count):
        if progress is not None:
            progress(done)
    return states
