"""Assimilation with dynamics: the latent transform also has to follow the simulator."""

from __future__ import annotations

from collections.abc import Callable

import torch
from torch import Tensor

from dashred.data.observation_operator import ObservationOperator
from dashred.models.adapter import AdaptedDecoder
from dashred.models.assimilation import Assimilation
from dashred.models.sampled_dynamics import SampledDynamics
from dashred.models.shred import SHRED

# q of the first epoch and its smallest value, in units of the std of a field, and the factor from
# one epoch to the next.
FIRST_ERROR, LEAST_ERROR, ANNEALING = 0.1, 0.01, 0.3
# Iterations of L-BFGS in an epoch, between two looks at the clock, and pairs that it remembers.
ITERATIONS, AT_ONCE, MEMORY = 60, 10, 100
# Weight of the squared law, in units of the scales. It keeps terms that nothing determines small.
LAW_PENALTY = 1e-3


class DynamicAssimilation(Assimilation):
    """Minimise the misfit to the sensors and the errors of the steps between samples.

    With ``û_t = F(h_t + T(h_t))``, F frozen, and the forecast ``ũ_{t+Δ} = Φ_Δ(û_t; ξ)``::

        mean ((H û_t − y_t)/σ)² + mean ((H ũ_{t+Δ} − y_{t+Δ})/σ)²
            + mean ‖û_{t+Δ} − ũ_{t+Δ}‖²/q² + λ mean T(h)² + μ ‖ξ‖²

    The unknowns are T, the coefficients ξ of the law, and later the adapter of the decoder. This is
    weak-constraint 4D-Var (Trémolet, Q. J. R. Meteorol. Soc. 132, 2006) with the network as the
    control variable. The error q of a step falls from epoch to epoch: at first the readings decide,
    at the end the simulator does. An epoch is a fit by L-BFGS, over all samples, because the
    objective is deterministic and its valleys are narrow. The support of the law is chosen at the
    end of an epoch (:class:`callbacks.law_regression.LawRegression`).

    Args:
        shred: network trained on simulations; its decoder gets an adapter.
        fit_operator: H of the fit sensors.
        validation_operator: H of the validation sensors.
        noise: σ of each fit sensor, ``(sensor,)``.
        scales: std of the trace of each fit sensor and each validation sensor.
        width: hidden units of T, and of the adapter.
        penalty: λ.
        dynamics: the simulator from sample to sample.
        adapter_epoch: epoch in which the adapter is opened; None never opens it.
        is_over: whether the time is up.
    """

    def __init__(
        self,
        shred: SHRED,
        fit_operator: ObservationOperator,
        validation_operator: ObservationOperator,
        noise: Tensor,
        scales: tuple[Tensor, Tensor],
        width: int,
        penalty: float,
        dynamics: SampledDynamics,
        adapter_epoch: int | None,
        is_over: Callable[[], bool],
    ) -> None:
        super().__init__(
            shred, fit_operator, validation_operator, noise, scales, width, penalty, 1.0, 0.0
        )
        self.automatic_optimization = False
        self.dynamics, self.adapter_epoch, self.is_over = dynamics, adapter_epoch, is_over
        latent, modes = shred.encoder.hidden_size, len(shred.spread)
        self.adapted = AdaptedDecoder(shred.decoder, latent, width, modes)
        self.shred.decoder = self.adapted

    def configure_optimizers(self) -> torch.optim.Optimizer:
        """Return L-BFGS on the transform, the adapter and the law."""
        return torch.optim.LBFGS(
            [
                *self.encoder.transform.parameters(),
                *self.adapted.adapter.parameters(),
                self.dynamics.law,
            ],
            max_iter=AT_ONCE,
            history_size=MEMORY,
            line_search_fn="strong_wolfe",
            tolerance_grad=1e-9,
            tolerance_change=1e-12,
        )

    def on_train_epoch_start(self) -> None:
        """Open the adapter when its epoch has come."""
        if self.adapter_epoch is not None and self.current_epoch >= self.adapter_epoch:
            self.adapted.open()

    def training_step(self, batch: tuple[Tensor, Tensor], index: int) -> None:
        """Minimise the loss of this epoch over the whole recording."""
        windows, fitted = batch
        optimizer = self.optimizers(use_pl_optimizer=False)
        assert isinstance(optimizer, torch.optim.Optimizer)
        # What L-BFGS has learnt about the curvature belongs to the q and the law of an epoch.
        optimizer.state.clear()
        error = max(LEAST_ERROR, FIRST_ERROR * ANNEALING**self.current_epoch)
        with torch.no_grad():
            latent = self.shred.encode(windows)
        parts: dict[str, Tensor] = {}

        def closure() -> Tensor:
            optimizer.zero_grad()
            parts.update(self._losses(latent, fitted, error))
            return parts["train"]

        for _ in range(ITERATIONS // AT_ONCE):
            optimizer.step(closure)
            if self.is_over():
                break
        for name, value in parts.items():
            self.log(f"loss/{name}", value, on_step=False, on_epoch=True, batch_size=len(windows))

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
            last = 0 if block.is_last else -1
            rows = len(own) + last
            gap = self.dynamics.scaled(fields[1:].double() - forecast)
            share = {
                "misfit": innovations[0][:rows].square().sum() / max(1, counts[0]),
                "forecast_misfit": innovations[1].square().sum() / max(1, counts[1]),
                "step_error": gap.square().flatten(1).mean(dim=1).sum() / steps / error**2,
                "transform": self.penalty
                * (moved - own)[:rows].square().mean(dim=1).sum()
                / len(latent),
            }
            torch.stack([value.double() for value in share.values()]).sum().backward()
            for name, value in share.items():
                sums[name] = sums.get(name, torch.zeros(())) + value.detach()
        size = LAW_PENALTY * (self.dynamics.law * self.dynamics.support).square().sum()
        if size.requires_grad:
            size.backward()
        sums["law"] = size.detach()
        return {"train": torch.stack([value.double() for value in sums.values()]).sum(), **sums}

    def _normalised(self, fitted: Tensor, fields: Tensor) -> Tensor:
        """Return the innovation in units of σ, zero where a sample is missing."""
        known = ~fitted.isnan()
        # Masked before the difference: the gradient of a masked NaN is NaN.
        readings = torch.where(known, fitted, 0.0)
        return torch.where(known, (readings - self.fit_operator(fields)) / self.noise, 0.0)
