"""Assimilation with dynamics: the latent transform also has to follow the simulator."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from typing import Any

import torch
from torch import Tensor, nn

from dashred.models.assimilation import Assimilation, AssimilationSensors
from dashred.models.dynamics.adapter import AdaptedDecoder
from dashred.models.dynamics.basis_error import BasisError
from dashred.models.dynamics.moving_basis import MovingBasis
from dashred.models.dynamics.network_fit import NetworkFit
from dashred.models.dynamics.sampled_dynamics import SampledDynamics
from dashred.models.dynamics.state_fit import FIRST_ERROR
from dashred.models.dynamics.step_residuals import FieldResidual, StepResidual
from dashred.models.dynamics.whitening import Whitening
from dashred.models.shred import SHRED, reconstruct

# Smallest q, in units of the std of a field, and the factor from one epoch to the next.
LEAST_ERROR, ANNEALING = 0.001, 0.3
# The fit ends if q would not fall below this share of its last value.
SETTLED = 0.9
# Least error of the background, in std of a field: SHRED knows a field that never changes exactly.
LEAST_BACKGROUND = 1e-3


class NetworkAssimilation(Assimilation):
    """Minimise the misfit to the sensors and the errors of the steps between samples.

    The loss is that of :class:`.network_fit.NetworkFit`. The unknowns are the latent transform T,
    the adapter of the decoder, and the coefficients ξ of the law. This is weak-constraint 4D-Var
    (Trémolet, Q. J. R. Meteorol. Soc. 132, 2006) with the network as the control variable, and the
    estimate of SHRED as the background. The error q of a step falls from q₀ from epoch to epoch: at
    first the readings decide, at the end the simulator does. An epoch is a fit by L-BFGS.

    Attributes:
        residual: what the errors of the steps are measured in; the fields at first.
        first_guess: F(h_t), ``(time, field, *grid)``.
        background: b in the units of the fields, ``(field,)``.
        error: q of the last epoch.
        steps_fit: whether the errors of the steps were within q at its end.

    Args:
        shred: network trained on simulations.
        sensors: that are fitted, with the σ of their errors, and those of the validation.
        width: hidden units of T, and of the adapter.
        penalty: λ.
        windows: of the recording, ``(time, lag, sensor)``; their latent states are whitened.
        background: b, RMSE of SHRED on simulations that it has not seen, in units of the std of
            each field, ``(field,)``.
        dynamics: the simulator from sample to sample.
        unexpressed: what the basis cannot express of a simulation.
        adapter: whether the decoder gets an adapter.
        is_over: whether the time is up.
    """

    first_guess: Tensor
    background: Tensor

    def __init__(
        self,
        shred: SHRED,
        sensors: AssimilationSensors,
        width: int,
        penalty: float,
        windows: Tensor,
        background: Tensor,
        dynamics: SampledDynamics,
        unexpressed: BasisError,
        adapter: bool,
        is_over: Callable[[], bool],
    ) -> None:
        # The rates are those of Adam, which does not fit this module.
        super().__init__(shred, sensors, width, penalty, rate=0.0, encoder_rate=0.0)
        self.automatic_optimization = False
        self.dynamics, self.is_over = dynamics, is_over
        self.residual: StepResidual = FieldResidual(dynamics)
        self.error, self.steps_fit = FIRST_ERROR, False
        own_error = unexpressed.scheme if adapter else unexpressed.step
        self.least_error = max(LEAST_ERROR, own_error)
        with torch.no_grad():
            states = shred.encode(windows)
            coefficients = shred.decoder(states)
        guess = reconstruct(shred.encode, shred, windows)
        self.register_buffer("first_guess", guess, persistent=False)
        least = background.clamp(min=LEAST_BACKGROUND)
        self.register_buffer("background", least * dynamics.spread, persistent=False)
        transform = self.encoder.transform
        transform.residual = nn.Sequential(Whitening(states), *transform.residual)
        if adapter:
            adapted = AdaptedDecoder(shred.decoder, Whitening(states), width, len(shred.spread))
            self.shred.decoder = nn.Sequential(adapted)
        self.basis = MovingBasis(self.shred, self.sensors, coefficients, unexpressed.readings)

    def configure_optimizers(self) -> torch.optim.Optimizer:
        """Return L-BFGS."""
        return self.network_fit().optimizer()

    def training_step(self, batch: tuple[Tensor, Tensor], index: int) -> Tensor:
        """Lower the loss over the whole recording."""
        windows, readings = batch
        with torch.no_grad():
            latent = self.shred.encode(windows)
            fields = self.shred.decode(self.encoder.transform(latent))
        if not bool(self.dynamics.forecasts(fields).square().sum().isfinite()):
            # The simulator blows up with the law that was chosen after the last epoch.
            self.dynamics.set_law(torch.zeros_like(self.dynamics.scales))
        self.error = self._next_error(self.current_epoch)
        parts = self.minimise(windows, latent, readings)
        self.steps_fit = parts.get("step_error", 2.0) <= 1.0
        self._support, self._last = self.dynamics.support.clone(), self.fields(windows)
        for name, value in parts.items():
            self.log(f"loss/{name}", value, on_step=False, on_epoch=True, batch_size=len(windows))
        return torch.tensor(parts.get("train", torch.inf))

    def minimise(self, windows: Tensor, latent: Tensor, readings: Tensor) -> dict[str, float]:
        """Fit the networks with the q of the epoch, and return the parts of the loss.

        Args:
            windows: of the recording, ``(time, lag, sensor)``.
            latent: h of all samples, ``(time, latent)``.
            readings: of the fit sensors, ``(time, sensor)``.
        """
        optimizer = self.optimizers(use_pl_optimizer=False)
        assert isinstance(optimizer, torch.optim.Optimizer)
        # The curvature of the loss with another q is of no use.
        optimizer.state.clear()
        weight = (self.error / FIRST_ERROR) ** 2
        found = self.network_fit().minimise(optimizer, latent, readings, self.error, weight)
        return {name: float(value) for name, value in found.items()}

    def on_train_epoch_end(self) -> None:
        """End the fit if neither q nor the terms of the law change any more."""
        settled = self.steps_fit and self._next_error(self.current_epoch + 1) > SETTLED * self.error
        if self.current_epoch and settled and torch.equal(self.dynamics.support, self._support):
            self.trainer.should_stop = True

    def load_state_dict(
        self, state_dict: Mapping[str, Any], strict: bool = True, assign: bool = False
    ) -> Any:
        """Take a state, with as many modes as it has."""
        self.basis.resize(state_dict["shred.pod.modes"], state_dict["shred.spread"])
        return super().load_state_dict(state_dict, strict, assign)

    @property
    def fitted(self) -> list[nn.Parameter]:
        """The weights of T, and of the adapter."""
        adapted = self.basis.adapted
        weights = [] if adapted is None else adapted.adapter.parameters()
        return [*self.encoder.transform.parameters(), *weights]

    def network_fit(self) -> NetworkFit:
        """Return the loss of the networks."""
        return NetworkFit(
            self.shred,
            self.encoder.transform,
            self.sensors,
            self.dynamics,
            self.residual,
            self.first_guess,
            self.background,
            self.penalty,
            [*self.fitted, self.dynamics.law],
            self.is_over,
        )

    def _next_error(self, epoch: int) -> float:
        """Return q of an epoch; it falls if the steps of the last one were within theirs.

        The networks of the first epoch may not have come to their minimum: q falls in any case.
        """
        if self.steps_fit or epoch == 1:
            return min(
                self.error, max(self.least_error, self.error * ANNEALING, self.basis.outside)
            )
        return self.error

    def validation_step(self, batch: tuple[Tensor, Tensor, Tensor], index: int) -> None:
        """Log the mean squared error on the fit and the validation sensors.

        Without sensors for the validation, later readings of the fit sensors serve for it. SHRED
        reads these, too, so that the estimate at their own times proves nothing. Then the forecasts
        from one sample to the next are compared.
        """
        windows, fitted, validated = batch
        fields = self.shred.decode(self.encoder(windows))
        self.log_innovation("fit", fitted, self.sensors.fit(fields), self.sensors.fit_scale)
        read = self._validation_readings(fields).to(validated)
        self.log_innovation("validate", validated, read, self.sensors.validation_scale)

    @torch.no_grad()
    def validation_error(self, windows: Tensor, validated: Tensor) -> float:
        """Return the RMSE of :meth:`validation_step`, in std of each trace.

        Args:
            windows: of all samples, ``(time, lag, sensor)``.
            validated: readings of the validation sensors, ``(time, sensor)``.
        """
        read = self._validation_readings(self.shred.decode(self.encoder(windows)))
        error = (validated - read) / self.sensors.validation_scale
        return float(error.square().nanmean().sqrt())

    def _validation_readings(self, fields: Tensor) -> Tensor:
        """Return what the validation sensors read in the estimate, or in its forecasts."""
        if self.sensors.validation.sensors == self.sensors.fit.sensors:
            fields = self.dynamics.forecasts(fields)
        read = self.sensors.validation(fields)
        # A forecast that blows up is wrong, not missing.
        return torch.where(read.isnan(), torch.inf, read)
