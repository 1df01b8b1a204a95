"""Assimilation with dynamics: the latent transform also has to follow the simulator."""

from __future__ import annotations

from collections.abc import Callable

import torch
from torch import Tensor, nn

from dashred.models.assimilation import Assimilation, AssimilationSensors
from dashred.models.dynamics.adapter import AdaptedDecoder
from dashred.models.dynamics.distillation import distil
from dashred.models.dynamics.network_fit import LAW_PENALTY, NetworkFit
from dashred.models.dynamics.sampled_dynamics import SampledDynamics
from dashred.models.dynamics.state_fit import FIRST_ERROR, Fitted, StateFit
from dashred.models.dynamics.weak_constraint import WeakConstraint
from dashred.models.dynamics.whitening import Whitening
from dashred.models.shred import SHRED, reconstruct

# Smallest q, in units of the std of a field, and the factor from one epoch to the next.
LEAST_ERROR, ANNEALING = 0.001, 0.3
# Least error of the background, in std of a field: SHRED knows a field that never changes exactly.
LEAST_BACKGROUND = 1e-3


class DynamicAssimilation(Assimilation):
    """Minimise the misfit to the sensors and the errors of the steps between samples.

    The loss is that of :class:`.network_fit.NetworkFit`. The unknowns are the latent transform T,
    the adapter of the decoder, and the coefficients ξ of the law. This is weak-constraint 4D-Var
    (Trémolet, Q. J. R. Meteorol. Soc. 132, 2006) with the network as the control variable, and the
    estimate of SHRED as the background. The error q of a step falls from q₀ from epoch to epoch: at
    first the readings decide, at the end the simulator does.

    The first epoch fits the networks by L-BFGS. What a network gives varies smoothly with the
    latent state, which leads past fields that fit the readings by chance. The later epochs minimise
    the same loss over the POD coefficients of all samples by Gauss–Newton steps
    (:mod:`.gauss_newton`), to which the networks are then fitted (:mod:`.distillation`). The
    support of the law is chosen at the end of an epoch
    (:class:`callbacks.law_regression.LawRegression`).

    Attributes:
        first_guess: F(h_t), ``(time, field, *grid)``.
        background: b in the units of the fields, ``(field,)``.
        steps_fit: whether the errors of the steps were within q at the end of the last epoch.

    Args:
        shred: network trained on simulations.
        sensors: that are fitted, with the σ of their errors, and those of the validation.
        width: hidden units of T, and of the adapter.
        penalty: λ.
        windows: of the recording, ``(time, lag, sensor)``; their latent states are whitened.
        background: b, RMSE of SHRED on simulations that it has not seen, in units of the std of
            each field, ``(field,)``.
        dynamics: the simulator from sample to sample.
        least_error: the smallest q, in std of a field.
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
        least_error: float,
        adapter: bool,
        is_over: Callable[[], bool],
    ) -> None:
        # The rates are those of Adam, which does not fit this module.
        super().__init__(shred, sensors, width, penalty, rate=0.0, encoder_rate=0.0)
        self.automatic_optimization = False
        self.dynamics, self.least_error, self.is_over = dynamics, least_error, is_over
        self._error, self.steps_fit = FIRST_ERROR, False
        with torch.no_grad():
            states = shred.encode(windows)
            self._guess = shred.decoder(states)
        guess = reconstruct(shred.encode, shred, windows)
        self.register_buffer("first_guess", guess, persistent=False)
        least = background.clamp(min=LEAST_BACKGROUND)
        self.register_buffer("background", least * dynamics.spread, persistent=False)
        transform = self.encoder.transform
        transform.residual = nn.Sequential(Whitening(states), *transform.residual)
        self.fitted = list(transform.parameters())
        if adapter:
            adapted = AdaptedDecoder(shred.decoder, Whitening(states), width, len(shred.spread))
            self.shred.decoder = nn.Sequential(adapted)
            self.fitted += adapted.adapter.parameters()

    def configure_optimizers(self) -> torch.optim.Optimizer:
        """Return L-BFGS for the first epoch; the later ones have methods of their own."""
        return self.network_fit().optimizer()

    def training_step(self, batch: tuple[Tensor, Tensor], index: int) -> Tensor:
        """Lower the loss over the whole recording."""
        windows, readings = batch
        with torch.no_grad():
            latent = self.shred.encode(windows)
        network = self.network_fit()
        if not bool(network.losses(latent, readings, self._error, 1.0)["train"].isfinite()):
            # The simulator blows up with the law that the last regression has chosen.
            self.dynamics.set_law(torch.zeros_like(self.dynamics.scales))
        if self.current_epoch == 0:
            optimizer = self.optimizers(use_pl_optimizer=False)
            assert isinstance(optimizer, torch.optim.Optimizer)
            found = network.minimise(optimizer, latent, readings, self._error, 1.0)
            parts = {name: float(value) for name, value in found.items()}
        else:
            self._error = self._next_error(self.current_epoch)
            fitted = self.state_fit(readings).fit(self._present(latent), self._error)
            parts = fitted.parts | {"network_error": self.take(windows, fitted)}
        self.steps_fit = parts.get("step_error", 2.0) <= 1.0
        for name, value in parts.items():
            self.log(f"loss/{name}", value, on_step=False, on_epoch=True, batch_size=len(windows))
        return torch.tensor(parts.get("train", torch.inf))

    def refit(
        self, batch: tuple[Tensor, Tensor], coefficients: Tensor, start: Tensor | None = None
    ) -> Fitted:
        """Return the minimum with another law, at the smallest q. The networks stay as they are.

        Args:
            batch: windows and fitted values of all samples.
            coefficients: of the law, ``(term,)``; those that are not zero are fitted.
            start: states at which the fit begins, ``(time, mode)``; None for those of the networks.
        """
        windows, readings = batch
        self.dynamics.set_law(coefficients)
        if start is None:
            with torch.no_grad():
                start = self._present(self.shred.encode(windows))
        return self.state_fit(readings).fit(start, self.least_error)

    @property
    def is_settled(self) -> bool:
        """Whether the steps fit the smallest q."""
        return self.steps_fit and self._error <= self.least_error

    def take(self, windows: Tensor, fitted: Fitted) -> float:
        """Take a law and fit the networks to its states; return what is left, RMS in std."""
        self.dynamics.set_law(fitted.coefficients)
        decoder: nn.Module = self.shred.decoder
        if isinstance(decoder, nn.Sequential) and isinstance(decoder[0], AdaptedDecoder):
            decoder = decoder[0]
        with torch.no_grad():
            latent = self.shred.encode(windows)
        scale = self.shred.spread / self.shred.pod.modes.shape[1] ** 0.5
        states, transform = fitted.unknowns.states, self.encoder.transform
        return distil(transform, decoder, self.fitted, latent, states, scale)

    def network_fit(self) -> NetworkFit:
        """Return the loss of the networks."""
        return NetworkFit(
            self.shred,
            self.encoder.transform,
            self.sensors,
            self.dynamics,
            self.first_guess,
            self.background,
            self.penalty,
            [*self.fitted, self.dynamics.law],
            self.is_over,
        )

    def state_fit(self, readings: Tensor) -> StateFit:
        """Return the loss of the states.

        Args:
            readings: of the fit sensors, ``(time, sensor)``, NaN where missing.
        """
        problem = WeakConstraint(
            self.dynamics,
            self.shred.pod,
            self.shred.spread,
            self.sensors.fit,
            self.sensors.noise,
            readings,
            self._guess,
            self.background,
            LAW_PENALTY,
        )
        return StateFit(problem, self.is_over)

    @torch.no_grad()
    def _present(self, latent: Tensor) -> Tensor:
        """Return the states that the networks give, ``(time, mode)``."""
        return self.shred.decoder(self.encoder.transform(latent)).double()

    def _next_error(self, epoch: int) -> float:
        """Return q of an epoch; it falls if the steps of the last one were within theirs.

        The networks of the first epoch may not have come to their minimum: q falls in any case.
        """
        if self.steps_fit or epoch == 1:
            return max(self.least_error, self._error * ANNEALING)
        return self._error

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
            fields = self._forecasts(fields)
        read = self.sensors.validation(fields)
        # A forecast that blows up is wrong, not missing.
        return torch.where(read.isnan(), torch.inf, read)

    def _forecasts(self, fields: Tensor) -> Tensor:
        """Return the forecast at each sample; the estimate at the first one of an episode."""
        found = fields.double().clone()
        for block in self.dynamics.blocks():
            rows = slice(block.rows.start + 1, block.rows.stop)
            found[rows] = self.dynamics.advance(block, fields[block.rows][:-1])
        return found
