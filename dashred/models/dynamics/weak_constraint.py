"""The loss of an assimilation with dynamics as a function of the states themselves."""

from __future__ import annotations

from collections.abc import Callable, Sequence

import torch
from jaxtyping import Float
from torch import Tensor

from dashred.core.budget import OutOfTimeError
from dashred.core.numerics.block_tridiagonal import BlockNormal
from dashred.data.observation_operator import ObservationOperator
from dashred.models.dynamics.sampled_dynamics import SampledDynamics
from dashred.models.dynamics.unknowns import Residuals, Unknowns
from dashred.models.pod import POD

# Change of a field, RMS in std, and of a coefficient, in units of its scale, by which derivatives
# are computed.
FIELD_CHANGE, LAW_CHANGE = 1e-6, 1e-4


class WeakConstraint:
    """The loss of :class:`.network_fit.NetworkFit` with the states in place of the network.

    The states are linear combinations of POD modes, and the error of a step is the part of it that
    lies in these modes: what they cannot express is no error of a step. At the first sample of an
    episode, the difference of each POD coefficient to the background has the std of the coefficient
    in the simulations. What a dissipative system forgets before a sensor reads it would be free
    otherwise.

    Args:
        dynamics: the simulator, with the terms of the law.
        pod: the modes.
        spread: std of each POD coefficient, ``(mode,)``.
        operator: H of the fit sensors.
        noise: σ of each fit sensor, ``(sensor,)``.
        readings: of the fit sensors, ``(time, sensor)``, NaN where missing.
        guess: c_t of the background, ``(time, mode)``.
        background: b of each field in units of the fields, ``(field,)``.
        penalty: weight of the squared law.
    """

    def __init__(
        self,
        dynamics: SampledDynamics,
        pod: POD,
        spread: Tensor,
        operator: ObservationOperator,
        noise: Tensor,
        readings: Float[Tensor, "time sensor"],
        guess: Float[Tensor, "time mode"],
        background: Float[Tensor, " field"],
        penalty: float,
    ) -> None:
        self.dynamics, self.pod, self.operator = dynamics, pod, operator
        self.spread, self.noise, self.guess = spread.double(), noise.double(), guess.double()
        self.known = ~readings.isnan()
        self.readings = torch.where(self.known, readings, 0.0).double()
        self.blocks = list(dynamics.blocks())
        self.linked = torch.zeros(len(guess), 1, dtype=torch.bool)
        for block in self.blocks:
            self.linked[block.rows.start : block.rows.stop - 1] = True
        self.first = torch.zeros_like(self.linked)
        self.first[[episode.first for episode in dynamics.episodes]] = True
        self.count = max(1, int(self.known.sum()))
        forecast = int((self.known[1:] & self.linked[:-1]).sum())
        cells = pod.modes.shape[1]
        # Square roots of the weights of single values, relative to that of a reading.
        self._of_forecast = (self.count / max(1, forecast)) ** 0.5
        self._of_step = (self.count / max(1, int(self.linked.sum())) / cells) ** 0.5
        self._of_state = (self.count / len(guess) / cells) ** 0.5
        self._of_law = (penalty * self.count) ** 0.5
        # In modes, the errors of fields with different b are correlated.
        std = (background.double() / pod.scale.double()).repeat_interleave(cells // len(pod.scale))
        modes = pod.modes.double() / std
        self._background = torch.linalg.cholesky(modes @ modes.T).T * self.spread
        self._change = FIELD_CHANGE * cells**0.5 / self.spread

    @property
    def precision(self) -> float:
        """Weight of a squared coefficient in units of its scale."""
        return self._of_law**2

    def fields(self, states: Float[Tensor, "time mode"]) -> Tensor:
        """Return the fields of POD coefficients, ``(time, field, *grid)``."""
        return self.pod.decode(states * self.spread)

    @torch.no_grad()
    def residuals(self, at: Unknowns, error: float, weight: float) -> Residuals:
        """Return the residuals.

        Args:
            at: the unknowns.
            error: q, in std of a field.
            weight: of the background.
        """
        return self._residuals(at, self._readings(at), error, weight)

    def _residuals(
        self, at: Unknowns, readings: tuple[Tensor, Tensor, Tensor], error: float, weight: float
    ) -> Residuals:
        """Return the residuals of readings that are known."""
        read, forecast, steps = readings
        scale = self._of_step / error * self.spread
        following = torch.roll(at.states, -1, dims=0)
        changes = (at.states - self.guess) @ self._background.T
        return Residuals(
            misfit=self._normalised(read, 0),
            forecast_misfit=self._normalised(forecast, 1) * self._of_forecast,
            step=torch.where(self.linked, (steps - following) * scale, 0.0),
            background=changes * (self._of_state * weight**0.5),
            start=torch.where(self.first, at.states - self.guess, 0.0),
            law=at.law * self._of_law,
        )

    @torch.no_grad()
    def equations(
        self,
        at: Unknowns,
        terms: Sequence[int],
        error: float,
        weight: float,
        is_over: Callable[[], bool],
    ) -> BlockNormal:
        """Return the normal equations of the linearised residuals.

        Args:
            at: where they are linearised.
            terms: whose coefficients are unknown.
            error: see :meth:`residuals`.
            weight: see :meth:`residuals`.
            is_over: whether the time is up.

        Raises:
            OutOfTimeError: it is up.
        """
        base = self._readings(at)
        own = self._residuals(at, base, error, weight)
        modes = len(self.spread)
        by_state = []
        for k in range(modes):
            if is_over():
                raise OutOfTimeError
            states = at.states.clone()
            states[:, k] += self._change[k]
            moved = self._readings(Unknowns(states, at.law))
            by_state.append(self._derivatives(base, moved, float(self._change[k]), error))
        by_law = []
        for j in terms:
            law = at.law.clone()
            law[j] += LAW_CHANGE
            moved = self._readings(Unknowns(at.states, law))
            by_law.append(self._derivatives(base, moved, LAW_CHANGE, error))
        # Rows of all residuals that start from a sample; columns of its modes, and of the law.
        of_states = torch.stack(by_state, dim=2)
        of_law = torch.stack(by_law, dim=2) if by_law else of_states[:, :, :0]
        residual = torch.cat([own.misfit, own.forecast_misfit, own.step], dim=1)
        scale = torch.where(self.linked, self._of_step / error * self.spread, 0.0)
        # A step lowers the next state by itself.
        to_next = -of_states[:, -modes:] * scale[:, :, None]
        background = self._background * (self._of_state * weight**0.5)
        diagonal = of_states.mT @ of_states + background.T @ background
        diagonal += torch.diag_embed(self.first.expand(-1, modes).double())
        diagonal[1:] += torch.diag_embed(scale[:-1].square())
        gradient = (
            (of_states.mT @ residual[..., None])[..., 0] + own.background @ background + own.start
        )
        gradient[1:] -= (scale * own.step)[:-1]
        border = of_states.mT @ of_law
        border[1:] -= (scale[:, :, None] * of_law[:, -modes:])[:-1]
        flat = of_law.flatten(0, 1)
        corner = flat.T @ flat + self.precision * torch.eye(len(by_law), dtype=flat.dtype)
        common = flat.T @ residual.flatten() + self._of_law * own.law[list(terms)]
        return BlockNormal(
            diagonal.numpy(),
            to_next[:-1].mT.numpy(),
            border.numpy(),
            corner.numpy(),
            -gradient.numpy(),
            -common.numpy(),
            own.cost,
        )

    def _readings(self, at: Unknowns) -> tuple[Tensor, Tensor, Tensor]:
        """Return the readings of the states and of the forecasts, and the modes of the forecasts.

        The last two are in the rows of the samples from which the forecasts start.
        """
        fields = self.fields(at.states)
        read = self.operator(fields)
        forecast, steps = torch.zeros_like(read), torch.zeros_like(at.states)
        self.dynamics.set_law(at.law * self.dynamics.scales)
        for block in self.blocks:
            rows = slice(block.rows.start, block.rows.stop - 1)
            later = self.dynamics.advance(block, fields[rows])
            forecast[rows] = self.operator(later)
            steps[rows] = self.pod.encode(later) / self.spread
        return read, forecast, steps

    def _normalised(self, read: Tensor, later: int) -> Tensor:
        """Return the innovations of readings in units of σ; of those of the next sample, or not."""
        known, values = (torch.roll(each, -later, dims=0) for each in (self.known, self.readings))
        if later:
            known = known & self.linked
        return torch.where(known, (read - values) / self.noise, 0.0)

    def _derivatives(
        self,
        base: tuple[Tensor, Tensor, Tensor],
        moved: tuple[Tensor, Tensor, Tensor],
        change: float,
        error: float,
    ) -> Tensor:
        """Return the derivatives of the residuals that start from each sample."""
        read, forecast, steps = (
            (there - here) / change for here, there in zip(base, moved, strict=True)
        )
        later = torch.roll(self.known, -1, dims=0) & self.linked
        return torch.cat(
            [
                torch.where(self.known, read / self.noise, 0.0),
                torch.where(later, forecast / self.noise * self._of_forecast, 0.0),
                torch.where(self.linked, steps * (self._of_step / error * self.spread), 0.0),
            ],
            dim=1,
        )
