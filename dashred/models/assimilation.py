"""LightningModule 2: fit a residual latent transform to the real sensors, with F frozen."""

from __future__ import annotations

import torch
from jaxtyping import Float
from lightning import LightningModule
from torch import Tensor, nn

from dashred.data.observation_operator import ObservationOperator
from dashred.models.shred import SHRED, reconstruct
from dashred.models.validation_error import log_rmse, log_squares


class LatentTransform(nn.Module):
    """``G_R = h + T(h)``, where T is a small network initialised to zero (Bao & Kutz 2025, §3)."""

    def __init__(self, latent: int, width: int) -> None:
        super().__init__()
        last = nn.Linear(width, latent)
        nn.init.zeros_(last.weight)
        nn.init.zeros_(last.bias)
        self.residual = nn.Sequential(nn.Linear(latent, width), nn.Tanh(), last)

    def forward(self, latent: Float[Tensor, "batch latent"]) -> Float[Tensor, "batch latent"]:
        """Return ``h + T(h)``."""
        return latent + self.residual(latent)


class AssimilatedEncoder(nn.Module):
    """``G_R(s_{t-k:t})``: SHRED's encoder followed by the latent transform."""

    def __init__(self, shred: SHRED, transform: LatentTransform) -> None:
        super().__init__()
        self.shred, self.transform = shred, transform

    def forward(self, windows: Float[Tensor, "batch lag sensor"]) -> Float[Tensor, "batch latent"]:
        """Return the assimilated latent state of windows."""
        return self.transform(self.shred.encode(windows))


class AssimilationSensors(nn.Module):
    """The sensors of an assimilation.

    Attributes:
        fit: H of the fit sensors.
        validation: H of the validation sensors.
        noise: σ of each fit sensor, ``(sensor,)``.
        fit_scale: std of the trace of each fit sensor, ``(sensor,)``; RMSEs are in units of it.
        validation_scale: that of each validation sensor, ``(sensor,)``.
    """

    noise: Tensor
    fit_scale: Tensor
    validation_scale: Tensor

    def __init__(
        self,
        fit: ObservationOperator,
        validation: ObservationOperator,
        noise: Tensor,
        fit_scale: Tensor,
        validation_scale: Tensor,
    ) -> None:
        super().__init__()
        self.fit, self.validation = fit, validation
        self.register_buffer("noise", noise.float())
        self.register_buffer("fit_scale", fit_scale.float())
        self.register_buffer("validation_scale", validation_scale.float())


class Assimilation(LightningModule):
    """Minimise ``mean ((H F(G_R(s')) - y')/σ)² + λ mean T(h)²`` over T, with F frozen.

    The values y' are from the p + q fit sensors; missing samples have no weight. If
    ``encoder_rate`` > 0, SHRED's LSTM is trained too; the decoder, the POD basis and the scaler
    stay fixed.

    Args:
        shred: network trained on simulations.
        sensors: that are fitted, and those of the validation.
        width: hidden units of T.
        penalty: λ.
        rate: learning rate of T.
        encoder_rate: learning rate of the LSTM.
    """

    def __init__(
        self,
        shred: SHRED,
        sensors: AssimilationSensors,
        width: int,
        penalty: float,
        rate: float,
        encoder_rate: float,
    ) -> None:
        super().__init__()
        self.shred = shred.requires_grad_(False)
        self.shred.encoder.requires_grad_(encoder_rate > 0)
        self.encoder = AssimilatedEncoder(shred, LatentTransform(shred.encoder.hidden_size, width))
        self.sensors = sensors
        self.penalty, self.rate, self.encoder_rate = penalty, rate, encoder_rate

    def training_step(self, batch: tuple[Tensor, Tensor], index: int) -> Tensor:
        """Return the loss of one batch of windows."""
        windows, fitted = batch
        latent = self.shred.encode(windows)
        moved = self.encoder.transform(latent)
        innovation = _innovation(fitted, self.sensors.fit(self.shred.decode(moved)))
        misfit = _mean_square(innovation / self.sensors.noise)
        loss = misfit + self.penalty * (moved - latent).square().mean()
        for name, value in {"loss/train": loss, "loss/misfit": misfit}.items():
            self.log(
                name,
                value,
                on_step=False,
                on_epoch=True,
                batch_size=len(windows),
                sync_dist=True,
            )
        return loss

    def validation_step(self, batch: tuple[Tensor, Tensor, Tensor], index: int) -> None:
        """Log the mean squared error on the fit and the validation sensors."""
        windows, fitted, validated = batch
        field = self.shred.decode(self.encoder(windows))
        pairs = {
            "fit": (fitted, self.sensors.fit, self.sensors.fit_scale),
            "validate": (validated, self.sensors.validation, self.sensors.validation_scale),
        }
        for name, (values, operator, scale) in pairs.items():
            self.log_innovation(name, values, operator(field), scale)

    def log_innovation(self, name: str, values: Tensor, read: Tensor, scale: Tensor) -> None:
        """Add the squared innovations of one batch to an RMSE.

        Args:
            name: of the RMSE, ``fit`` or ``validate``.
            values: of the sensors, ``(time, sensor)``, NaN where missing.
            read: what they read in the estimate, same shape.
            scale: unit of each sensor, ``(sensor,)``.
        """
        innovation = _innovation(values, read) / scale
        known = int((~innovation.isnan()).sum())
        log_squares(self, f"sensors_{name}", _mean_square(innovation), known)

    def on_validation_epoch_end(self) -> None:
        """Log the RMSEs, in units of each trace's std."""
        for name in ("fit", "validate"):
            log_rmse(self, f"sensors_{name}")

    def fields(self, windows: Tensor) -> Tensor:
        """Return the assimilated fields of windows, ``(time, field, *grid)``, on the CPU."""
        return reconstruct(self.encoder, self.shred, windows.to(self.device)).cpu()

    @property
    def is_consistent(self) -> bool:
        """Whether the present state may be taken; the sensors alone contradict none."""
        return True

    def configure_optimizers(self) -> torch.optim.Optimizer:
        """Return Adam on the transform, and on the LSTM if ``encoder_rate`` > 0."""
        groups = [{"params": self.encoder.transform.parameters(), "lr": self.rate}]
        if self.encoder_rate > 0:
            groups.append({"params": self.shred.encoder.parameters(), "lr": self.encoder_rate})
        return torch.optim.Adam(groups)


def _innovation(recorded: Tensor, read: Tensor) -> Tensor:
    """Return ``y - Hv``, NaN where y is missing."""
    return recorded - read


def _mean_square(values: Tensor) -> Tensor:
    known = ~values.isnan()
    return torch.where(known, values, 0.0).square().sum() / known.sum().clamp(min=1)
