"""One step of a simulator from sample to sample, for many states with times of their own."""

from __future__ import annotations

from torch import Tensor

from dashred.physics.backends.input_signals import Array
from dashred.physics.grids.transforms import modes_of, points_of
from dashred.physics.runge_kutta import advance
from dashred.physics.solvers.etdrk4 import ETDRK4
from dashred.physics.solvers.forcing import Forcing
from dashred.physics.solvers.rhs import GridTendency, SpectralTendency
from dashred.physics.solvers.schedule import round_up
from dashred.physics.solvers.simulate import tendency_on_device
from dashred.physics.system import System


def is_differentiable(system: System) -> bool:
    """Return whether :class:`SampleStep` can step a system.

    Programs have no derivatives that torch knows. Cells with boundary conditions are stepped
    implicitly, and adaptive methods have no step of a fixed length.
    """
    explicit = system.spectral or system.tableau is not None
    return system.program is None and not system.has_conditions and explicit


class SampleStep:
    """``Φ_Δ(u, t; ξ)``, which torch can differentiate by u and ξ.

    :func:`dashred.physics.solvers.simulate.simulate` starts all states at the same time. Here each
    has its own, so that the steps from all samples of a record are one batch also where the
    equations depend on time. Steps do not end at jumps of an input between samples.

    Args:
        system: the simulator; :func:`is_differentiable` holds.
        longest: largest Δ, in units of time.
    """

    def __init__(self, system: System, longest: float) -> None:
        self.system = system
        self.count = max(1, round_up(longest / system.dt))

    def __call__(
        self, states: Tensor, begins: Tensor, durations: Tensor, forcing: Forcing | None
    ) -> Tensor:
        """Return the states one sample later, ``(batch, field, *grid)``.

        Args:
            states: u, ``(batch, field, *grid)``, float64.
            begins: t of each state, ``(batch,)``.
            durations: Δ of each state, ``(batch,)``; all are equal for spectral fields.
            forcing: additional terms. Coefficients with one row are those of all states.
        """
        space = (1,) * len(self.system.grid.shape)
        times = begins.reshape(-1, *space).numpy()
        if self.system.spectral:
            return self._spectral(states, times, float(durations[0]) / self.count, forcing)
        return self._on_grid(states, times, durations.reshape(-1, 1, *space) / self.count, forcing)

    def _on_grid(self, states: Tensor, times: Array, h: Tensor, forcing: Forcing | None) -> Tensor:
        tendency, tableau = GridTendency(self.system, forcing), self.system.tableau
        assert tableau is not None
        own = h[:, 0].numpy()

        def rate(state: Tensor, steps: float) -> Tensor:
            return h * tendency(state, times + steps * own)

        # In units of each state's step, so that the method sees steps of length one.
        for i in range(self.count):
            states = advance(tableau, rate, states, float(i), 1.0)
        return states

    def _spectral(self, states: Tensor, times: Array, h: float, forcing: Forcing | None) -> Tensor:
        tendency: SpectralTendency = tendency_on_device(self.system, forcing, None)
        stepper = ETDRK4(tendency.linear, tendency, h)
        shape = self.system.grid.shape
        modes = tendency.dealias(modes_of(states, shape))
        for i in range(self.count):
            begin = times + i * h
            modes = stepper.step(modes, begin, begin + h)
        return points_of(modes, shape)
