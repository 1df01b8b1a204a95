"""The loss of an assimilation with dynamics as a function of the networks."""

from __future__ import annotations

from collections.abc import Callable, Sequence

import torch
from torch import Tensor, nn

from dashred.models.assimilation import AssimilationSensors, LatentTransform
from dashred.models.dynamics.sampled_dynamics import SampledDynamics
from dashred.models.dynamics.step_residuals import StepResidual
from dashred.models.shred import SHRED

# Iterations of L-BFGS, of which some run between two looks at the clock, and pairs that it
# remembers.
ITERATIONS, AT_ONCE, MEMORY = 120, 10, 100
# Loss of a field from which the simulator blows up.
REFUSED = 1e30
# Weight of the squared law, in units of the scales. It keeps terms that nothing determines small.
LAW_PENALTY = 1e-3


class NetworkFit:
    """The loss, with ``û_t = F(h_t + T(h_t)) + A(h_t + T(h_t))`` and ``ũ_{t+Δ} = Φ_Δ(û_t; ξ)``.

    ::

        mean ((H û_t − y_t)/σ)² + mean ((H ũ_{t+Δ} − y_{t+Δ})/σ)²
            + mean ‖r_t‖²/q²
            + w mean ‖û_t − F(h_t)‖²/b² + λ mean T(h)² + μ ‖ξ‖²

    r_t is the error of a step, ``û_{t+Δ} − ũ_{t+Δ}`` or one in the latent space.

    Args:
        shred: with the frozen decoder F, and the adapter A if there is one.
        transform: h + T(h).
        sensors: that are fitted.
        dynamics: the simulator, with the law.
        residual: r.
        first_guess: F(h_t), ``(time, field, *grid)``.
        background: b in the units of the fields, ``(field,)``.
        penalty: λ.
        fitted: weights that are fitted, and ξ.
        is_over: whether the time is up.
    """

    def __init__(
        self,
        shred: SHRED,
        transform: LatentTransform,
        sensors: AssimilationSensors,
        dynamics: SampledDynamics,
        residual: StepResidual,
        first_guess: Tensor,
        background: Tensor,
        penalty: float,
        fitted: Sequence[nn.Parameter],
        is_over: Callable[[], bool],
    ) -> None:
        self.shred, self.transform, self.sensors = shred, transform, sensors
        self.dynamics, self.residual = dynamics, residual
        self.first_guess, self.background = first_guess, background
        self.penalty, self.fitted, self.is_over = penalty, list(fitted), is_over

    def optimizer(self) -> torch.optim.Optimizer:
        """Return L-BFGS on all weights and the law."""
        return torch.optim.LBFGS(
            self.fitted,
            max_iter=AT_ONCE,
            history_size=MEMORY,
            line_search_fn="strong_wolfe",
            tolerance_grad=1e-9,
            tolerance_change=1e-12,
        )

    def minimise(
        self,
        optimizer: torch.optim.Optimizer,
        latent: Tensor,
        readings: Tensor,
        error: float,
        weight: float,
    ) -> dict[str, Tensor]:
        """Return the parts of the lowest loss, whose weights are kept.

        An epoch is a fit over all samples, because the objective is deterministic and its valleys
        are narrow.

        Args:
            optimizer: of :meth:`optimizer`.
            latent: h of all samples, ``(time, latent)``.
            readings: of the fit sensors, ``(time, sensor)``.
            error: q, in std of a field.
            weight: w.
        """
        parts: dict[str, Tensor] = {}
        lowest = [value.detach().clone() for value in self.fitted]

        def closure() -> float:
            optimizer.zero_grad()
            found = self.losses(latent, readings, error, weight)
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

    def losses(
        self, latent: Tensor, readings: Tensor, error: float, weight: float
    ) -> dict[str, Tensor]:
        """Return the loss and its parts; their gradients are accumulated block by block."""
        blocks = list(self.dynamics.blocks())
        known = ~readings.isnan()
        steps = sum(len(block.begins) for block in blocks)
        counts = int(known.sum()), sum(int(known[b.rows][1:].sum()) for b in blocks)
        sums: dict[str, Tensor] = {}
        for block in blocks:
            own = latent[block.rows]
            moved = self.transform(own)
            fields = self.shred.decode(moved)
            forecast = self.dynamics.advance(block, fields[:-1])
            innovations = (
                self._normalised(readings[block.rows], fields),
                self._normalised(readings[block.rows][1:], forecast),
            )
            # Neighbouring blocks share a sample, which counts once.
            rows = len(own) if block.is_last else len(own) - 1
            gap = self.residual(block, moved, fields, forecast)
            changes = (fields - self.first_guess[block.rows])[:rows].transpose(1, -1)
            share = {
                "misfit": innovations[0][:rows].square().sum() / max(1, counts[0]),
                "forecast_misfit": innovations[1].square().sum() / max(1, counts[1]),
                "step_error": gap.square().flatten(1).mean(dim=1).sum() / steps / error**2,
                "background": weight
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

    def _normalised(self, readings: Tensor, fields: Tensor) -> Tensor:
        """Return the innovation in units of σ, zero where a sample is missing."""
        known = ~readings.isnan()
        # Masked before the difference: the gradient of a masked NaN is NaN.
        values = torch.where(known, readings, 0.0)
        return torch.where(known, (values - self.sensors.fit(fields)) / self.sensors.noise, 0.0)
