"""One system compiled for many runs, whatever kind it is."""

from __future__ import annotations

from collections.abc import Callable, Sequence

from torch import Tensor

from dashred.physics.compiled_march import CompiledMarch
from dashred.physics.compiled_ode import CompiledOde
from dashred.physics.forcing import Forcing
from dashred.physics.linearisation import NotSeparableError
from dashred.physics.simulate import simulate
from dashred.physics.system import System, Term

Run = Callable[[Tensor, Tensor, Tensor], Tensor]


def compiled(system: System, terms: Sequence[Term]) -> Run:
    """Return ``run(start, times, weights)``: :func:`simulate` with weights ``(batch, term)``.

    Spectral systems and ODE systems with ``rk4`` run compiled, on the CPU; what cannot be
    compiled goes through :func:`simulate` itself.

    Args:
        system: the simulator.
        terms: whatever a trajectory may carry, lets and parameters resolved.
    """
    if not system.axes and system.method == "rk4":
        return CompiledOde(system, terms)
    if system.spectral:
        try:
            return CompiledMarch(system, terms)
        except (NotSeparableError, ArithmeticError):
            pass

    def run(start: Tensor, times: Tensor, weights: Tensor) -> Tensor:
        return simulate(system, start, times, Forcing(tuple(terms), weights))

    return run
