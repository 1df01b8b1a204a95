"""Assimilation with dynamics: the latent transform also has to follow the simulator."""

from __future__ import annotations

from collections.abc import Callable

import torch
from torch import Tensor, nn

from dashred.models.assimilation import Assimilation, AssimilationSensors
from dashred.models.dynamics.adapter import AdaptedDecoder
from dashred.models.dynamics.sampled_dynamics import SampledDynamics
from dashred.models.dynamics.whitening import Whitening
from dashred.models.shred import SHRED, reconstruct

# q of the first epoch and its smallest value, in units of the std of a field, and the factor from
# one epoch to the next.
FIRST_ERROR, LEAST_ERROR, ANNEALING = 0.1, 0.003, 0.3
# Iterations of L-BFGS in an epoch, between two looks at the clock, and pairs that it remembers.
ITERATIONS, AT_ONCE, MEMORY = 120, 10, 100
# Loss of a field from which the simulator blows up.
REFUSED = 1e30
# Least error of the background, in std of a field: SHRED knows a field that never changes exactly.
LEAST_BACKGROUND = 1e-3
# Weight of the squared law, in units of the scales. It keeps terms that nothing determines small.
LAW_PENALTY = 1e-3


class DynamicAssimilation(Assimilation):
    """Minimise the misfit to the sensors and the errors of the steps between samples.

    With ``û_t = F(h_t + T(h_t))``, F frozen, and the forecast ``ũ_{t+Δ} = Φ_Δ(û_t; ξ)``::

        mean ((H û_t − y_t)/σ)² + mean ((H ũ_{t+Δ} − y_{t+Δ})/σ)²
            + mean ‖û_{t+Δ} − ũ_{t+Δ}‖²/q²
            + (q/q₀) mean ‖û_t − F(h_t)‖²/b² + λ mean T(h)² + μ ‖ξ‖²

    The unknowns are T, the adapter of the decoder, and the coefficients ξ of the law. This is
    weak-constraint 4D-Var (Trémolet, Q. J. R. Meteorol. Soc. 132, 2006) with the network as the
    control variable, and the estimate of SHRED as the background. The error q of a step falls from
    q₀ after each epoch whose steps fit within it: at first the readings decide, at the end the
    simulator does. An epoch is a fit by L-BFGS, over all samples, because the
    objective is deterministic and its valleys are narrow. The support of the law is chosen at the
    end of an epoch (:class:`callbacks.law_regression.LawRegression`).

    Attributes:
        first_guess: F(h_t), ``(time, field, *grid)``.
        background: b in the units of the fields, ``(field,)``.
        steps_fit: whether the errors of the steps were within q at the end of the last epoch.

    Args:
        shred: network trained on simulations.
        sensors: that are fitted, and those of the validation.
        width: hidden units of T, and of the adapter.
        penalty: λ.
        windows: of the recording, ``(time, lag, sensor)``; their latent states are whitened.
        background: b, RMSE of SHRED on simulations that it has not seen, in units of the std of
            each field, ``(field,)``.
        dynamics: the simulator from sample to sample.
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
        adapter: bool,
        is_over: Callable[[], bool],
    ) -> None:
        # The rates are those of Adam, which does not fit this module.
        super().__init__(shred, sensors, width, penalty, rate=0.0, encoder_rate=0.0)
        self.automatic_optimization = False
        self.dynamics, self.is_over = dynamics, is_over
        self._error, self.steps_fit = FIRST_ERROR, False
        with torch.no_grad():
            states = shred.encode(windows)
        guess = reconstruct(shred.encode, shred, windows)
        self.register_buffer("first_guess", guess, persistent=False)
        least = background.clamp(min=LEAST_BACKGROUND)
        self.register_buffer("background", least * dynamics.spread, persistent=False)
        transform = self.encoder.transform
        transform.residual = nn.Sequential(Whitening(states), *transform.residual)
        self.fitted = [*transform.parameters(), dynamics.law]
        if adapter:
            adapted = AdaptedDecoder(shred.decoder, Whitening(states), width, len(shred.spread))
            self.shred.decoder = nn.Sequential(adapted)
            self.fitted += adapted.adapter.parameters()

    def configure_optimizers(self) -> torch.optim.Optimizer:
        """Return L-BFGS on the transform, the adapter and the law."""
        return torch.optim.LBFGS(
            self.fitted,
            max_iter=AT_ONCE,
            history_size=MEMORY,
            line_search_fn="strong_wolfe",
            tolerance_grad=1e-9,
            tolerance_change=1e-12,
        )

    def training_step(self, batch: tuple[Tensor, Tensor], index: int) -> Tensor:
        """Minimise the loss of this epoch over the whole recording."""
        windows, fitted = batch
        error = self._next_error()
        with torch.no_grad():
            latent = self.shred.encode(windows)
        if not bool(self._losses(latent, fitted, error)["train"].isfinite()):
            # The simulator blows up with the law that the last regression has chosen.
            self.dynamics.set_law(torch.zeros_like(self.dynamics.scales))
        optimizer = self.optimizers(use_pl_optimizer=False)
        assert isinstance(optimizer, torch.optim.Optimizer)
        # What L-BFGS has learnt about the curvature belongs to the q and the law of an epoch.
        optimizer.state.clear()
        parts = self._minimise(optimizer, latent, fitted, error)
        self.steps_fit = bool(parts) and float(parts["step_error"]) <= 1.0
        for name, value in parts.items():
            self.log(f"loss/{name}", value, on_step=False, on_epoch=True, batch_size=len(windows))
        return parts.get("train", torch.tensor(REFUSED))

    def refit(self, batch: tuple[Tensor, Tensor], coefficients: Tensor) -> dict[str, float]:
        """Return the parts of the lowest loss with another law, at the smallest q.

        The unknowns of the lowest loss are kept.

        Args:
            batch: windows and fitted values of all samples.
            coefficients: of the law, ``(term,)``; those that are not zero are fitted.
        """
        windows, fitted = batch
        self.dynamics.set_law(coefficients)
        with torch.no_grad():
            latent = self.shred.encode(windows)
        optimizer = self.configure_optimizers()
        parts = self._minimise(optimizer, latent, fitted, LEAST_ERROR)
        return {name: float(value) for name, value in parts.items()}

    def _minimise(
        self, optimizer: torch.optim.Optimizer, latent: Tensor, fitted: Tensor, error: float
    ) -> dict[str, Tensor]:
        """Return the parts of the lowest loss, whose unknowns are kept."""
        parts: dict[str, Tensor] = {}
        lowest = [value.detach().clone() for value in self.fitted]

        def closure() -> float:
            optimizer.zero_grad()
            found = self._losses(latent, fitted, error)
            if not bool(found["train"].isfinite()):
                # The simulator blows up from such a field: the line search goes back.
                optimizer.zero_grad()
                return REFUSED
            if not parts or found["train"] < parts["train"]:
                parts.update(found)
                lowest[:] = [value.detach().clone() for value in self.fitted]
            return found["train"].item()

        for _ in range(ITERATIONS // AT_ONCE):
            optimizer.step(closure)
            # A line search that has seen refused fields may end anywhere.
            if self.is_over() or not all(bool(value.isfinite().all()) for value in self.fitted):
                break
        with torch.no_grad():
            for value, kept in zip(self.fitted, lowest, strict=True):
                value.copy_(kept)
        return parts

    def _next_error(self) -> float:
        """Return q of this epoch; it falls if the steps of the last epoch were within theirs."""
        if self.steps_fit:
            self._error = max(LEAST_ERROR, self._error * ANNEALING)
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
        if self.sensors.validation.sensors == self.sensors.fit.sensors:
            fields = self._forecasts(fields)
        read = self.sensors.validation(fields).to(validated)
        # A forecast that blows up is wrong, not missing.
        read = torch.where(read.isnan(), torch.inf, read)
        self.log_innovation("validate", validated, read, self.sensors.validation_scale)

    def _forecasts(self, fields: Tensor) -> Tensor:
        """Return the forecast at each sample; the estimate at the first one of an episode."""
        found = fields.double().clone()
        for block in self.dynamics.blocks():
            rows = slice(block.rows.start + 1, block.rows.stop)
            found[rows] = self.dynamics.advance(block, fields[block.rows][:-1])
        return found

    def _losses(self, latent: Tensor, fitted: Tensor, error: float) -> dict[str, Tensor]:
        """Return the loss and its parts; their gradients are accumulated block by block."""
        blocks = list(self.dynamics.blocks())
        known = ~fitted.isnan()
        steps = sum(len(block.begins) for block in blocks)
        counts = int(known.sum()), sum(int(known[b.rows][1:].sum()) for b in blocks)
        sums: dict[str, Tensor] = {}
        for block in blocks:
            own = latent[block.rows]
            moved = self.encoder.transform(own)
            fields = self.shred.decode(moved)
            forecast = self.dynamics.advance(block, fields[:-1])
            innovations = (
                self._normalised(fitted[block.rows], fields),
                self._normalised(fitted[block.rows][1:], forecast),
            )
            # Neighbouring blocks share a sample, which counts once.
            rows = len(own) if block.is_last else len(own) - 1
            gap = self.dynamics.scaled(fields[1:].double() - forecast)
            changes = (fields - self.first_guess[block.rows])[:rows].transpose(1, -1)
            share = {
                "misfit": innovations[0][:rows].square().sum() / max(1, counts[0]),
                "forecast_misfit": innovations[1].square().sum() / max(1, counts[1]),
                "step_error": gap.square().flatten(1).mean(dim=1).sum() / steps / error**2,
                "background": (error / FIRST_ERROR)
                * (changes / self.background).square().flatten(1).mean(dim=1).sum()
                / len(latent),
                "transform": self.penalty
                * (moved - own)[:rows].square().mean(dim=1).sum()
                / len(latent),
            }
            torch.stack([value.double() for value in share.values()]).sum().backward()
            for name, value in share.items():
                sums[name] = sums.get(name, torch.zeros(())) + value.detach()
        size = LAW_PENALTY * (self.dynamics.law * self.dynamics.support).square().sum()
        size.backward()
        sums["law"] = size.detach()
        return {"train": torch.stack([value.double() for value in sums.values()]).sum(), **sums}

    def _normalised(self, fitted: Tensor, fields: Tensor) -> Tensor:
        """Return the innovation in units of σ, zero where a sample is missing."""
        known = ~fitted.isnan()
        # Masked before the difference: the gradient of a masked NaN is NaN.
        readings = torch.where(known, fitted, 0.0)
        return torch.where(known, (readings - self.sensors.fit(fields)) / self.sensors.noise, 0.0)
