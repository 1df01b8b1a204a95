"""The simulated ensemble as windows of sensor histories and POD coefficients."""

from __future__ import annotations

import torch
from jaxtyping import Float
from lightning import LightningDataModule
from torch import Tensor

from dashred.physics.ensemble import Ensemble
from dashred.sensing.observation import ObservationOperator
from dashred.sensing.pod import POD
from dashred.sensing.scaler import Scaler
from dashred.sensing.windows import windows
from datamodules.batches import Batches, ordered_batches, shuffled_batches

VALIDATION_BATCH = 1024
FIRST_AGAIN, LAST_AGAIN = 4, 2


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
        """Return clean stretches of ``2k + 1`` samples and the ``k + 1`` last targets of each.

        And how many of its first samples only repeat the next: there are none before a record.
        One pass of the LSTM then trains k + 1 windows, with histories of k + 1 samples and more,
        at a tenth of the cost of as many separate windows. Noise is drawn by the LightningModule.
        Stretches overlap, but for the first and the last of a member: these come again, and the
        first, whose windows have hardly any history and the largest errors, most of all.
        """
        long = windows(self.observed("train"), 2 * self.lags)
        last = long.shape[1] - 1
        every = range(self.lags, last, max(1, self.lags // 2))
        ends = [*every, last, *[self.lags] * FIRST_AGAIN, *[last] * LAST_AGAIN]
        coefficients = self.coefficients("train")
        targets = torch.stack([coefficients[:, end - self.lags : end + 1] for end in ends], dim=1)
        repeated = torch.tensor([max(0, 2 * self.lags - end) for end in ends])
        tensors = _flat(long[:, ends]), _flat(targets), repeated.repeat(len(long))
        return shuffled_batches(tensors, self.batch, self.seed)

    def val_dataloader(self) -> Batches:
        """Return noisy windows and coefficients of the validation members."""
        noisy, coefficients = self.noisy_windows("validation"), self.coefficients("validation")
        return ordered_batches((_flat(noisy), _flat(coefficients)), VALIDATION_BATCH)


def _flat(values: Tensor) -> Tensor:
    return values.flatten(0, 1).float().contiguous()
