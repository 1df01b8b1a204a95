"""The simulated ensemble as windows of sensor histories and POD coefficients."""

from __future__ import annotations

import torch
from jaxtyping import Float
from lightning import LightningDataModule
from torch import Tensor

from dashred.data.observation_operator import ObservationOperator
from dashred.models.lag_windows import windows
from dashred.models.pod import POD
from dashred.models.scaler import Scaler
from dashred.physics.runs.ensemble import Ensemble
from datamodules.batches import Batches, ordered_batches, shuffled_batches

VALIDATION_BATCH = 1024
LAST_AGAIN = 2


class SimulationDataModule(LightningDataModule):
    """What SHRED learns from: simulated members, cut into training, validation and test members.

    The scaler and the POD basis are fitted on training members alone. Half of the held-out
    members stop the training early, the other half measure it.

    Attributes:
        scaler: of the input sensors.
        pod: basis of the field.
        spread: std of each POD coefficient, ``(mode,)``.

    Args:
        ensemble: simulated trajectories.
        operator: reads SHRED's input sensors.
        noise: std of each input sensor, ``(sensor,)``.
        lags: samples of history behind the present one.
        modes: POD modes.
        held_out: members not trained on.
        batch: stretches in a training batch.
        seed: of the batches' order and of the held-out members' noise.
    """

    def __init__(
        self,
        ensemble: Ensemble,
        operator: ObservationOperator,
        noise: Tensor,
        lags: int,
        modes: int,
        held_out: int,
        batch: int,
        seed: int,
    ) -> None:
        super().__init__()
        self.ensemble, self.operator, self.noise = ensemble, operator, noise
        self.lags, self.batch, self.seed = lags, batch, seed
        members = len(ensemble.states)
        self.members = {
            "train": range(members - held_out),
            "validation": range(members - held_out, members - held_out // 2),
            "test": range(members - held_out // 2, members),
        }
        training = ensemble.states[: members - held_out]
        self.pod = POD.fit(training.flatten(0, 1), modes)
        self.scaler = Scaler.fit(self.observed("train"))
        self.spread = self.coefficients("train").flatten(0, 1).std(dim=0)

    def states(self, part: str) -> Float[Tensor, "member time ..."]:
        """Return the trajectories of one part of the members."""
        return self.ensemble.states[list(self.members[part])]

    def observed(self, part: str) -> Float[Tensor, "member time sensor"]:
        """Return what the input sensors read on one part of the members, without noise."""
        return self.operator(self.states(part))

    def coefficients(self, part: str) -> Float[Tensor, "member time mode"]:
        """Return the POD coefficients of one part of the members."""
        return self.pod.encode(self.states(part))

    def noisy_windows(self, part: str) -> Float[Tensor, "member time lag sensor"]:
        """Return windows of noisy histories; the noise is fixed by the seed and the part."""
        traces = self.observed(part)
        generator = torch.Generator().manual_seed(self.seed * 2 + (part == "test"))
        noise = torch.randn(traces.shape, generator=generator, dtype=traces.dtype)
        return windows(traces + self.noise * noise, self.lags)

    def train_dataloader(self) -> Batches:
        """Return clean stretches of ``k + 1`` samples and the targets of their second half.

        And how many of its first samples only repeat the next: there are none before a record.
        One pass of the LSTM then trains as many windows as there are targets, at a tenth of the
        cost of so many separate ones. The network that reads a recording has its whole history of
        k samples, longer than the shortest that it is trained with. Noise is drawn by the
        LightningModule. Stretches overlap, but for the last of a member: it comes again.
        """
        half = self.lags // 2
        stretches, coefficients = (
            windows(self.observed("train"), self.lags),
            self.coefficients("train"),
        )
        last = stretches.shape[1] - 1
        ends = torch.tensor([*range(0, last, max(1, half // 2)), *[last] * (1 + LAST_AGAIN)])
        # Where a record's first sample is repeated, so is its state.
        at = (ends[:, None] + torch.arange(-half, 1)).clamp(min=0)
        repeated = (self.lags - ends).clamp(min=0).repeat(len(stretches))
        tensors = _flat(stretches[:, ends]), _flat(coefficients[:, at]), repeated
        return shuffled_batches(tensors, self.batch, self.seed)

    def val_dataloader(self) -> Batches:
        """Return noisy windows and coefficients of the validation members."""
        noisy, coefficients = self.noisy_windows("validation"), self.coefficients("validation")
        return ordered_batches((_flat(noisy), _flat(coefficients)), VALIDATION_BATCH)


def _flat(values: Tensor) -> Tensor:
    return values.flatten(0, 1).float().contiguous()
