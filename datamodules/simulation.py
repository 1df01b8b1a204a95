"""The simulated ensemble as windows of sensor histories and POD coefficients."""

from __future__ import annotations

import torch
from jaxtyping import Float
from lightning import LightningDataModule
from torch import Tensor

from dashred.data.observation_operator import ObservationOperator
from dashred.models.lag_windows import windows
from dashred.models.scaler import Scaler
from dashred.models.stored_pod import fit_pod
from dashred.physics.runs.ensemble import Ensemble
from dashred.physics.runs.stored_states import States, each_state, part
from datamodules.batches import Batches, Share, ordered_batches, shuffled_batches

VALIDATION_BATCH = 1024
LAST_REPEATS = 2


class SimulationDataModule(LightningDataModule):
    """Simulated ensemble, split into training, validation and test members.

    The scaler and the POD basis are fitted on the training members only. Half of the held-out
    members are used for early stopping, the other half measure the error.

    Attributes:
        scaler: of the input sensors.
        pod: basis of the field.
        spread: std of each POD coefficient, ``(mode,)``.

    Args:
        ensemble: simulated trajectories.
        operator: observation operator of SHRED's input sensors.
        noise: std of each input sensor, ``(sensor,)``.
        lags: number of past samples in a window.
        modes: number of POD modes.
        held_out: number of members that are not trained on.
        batch: sequences per training batch.
        seed: of the order of the batches and of the noise on held-out members.
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
        self.pod = fit_pod(part(ensemble.states, slice(0, members - held_out)), modes)
        self.scaler = Scaler.fit(self.observed("train"))
        self.spread = self.coefficients("train").flatten(0, 1).std(dim=0)

    def states(self, name: str) -> States:
        """Return the trajectories of one part: train, validation or test."""
        states, members = self.ensemble.states, self.members[name]
        # A copy begins at an address of its own, on which the rounding of sums depends.
        if isinstance(states, Tensor):
            return states[list(members)]
        return states.part(slice(members.start, members.stop))

    def observed(self, name: str) -> Float[Tensor, "member time sensor"]:
        """Return the noise-free values of the input sensors for one part."""
        return each_state(self.operator, self.states(name))

    def coefficients(self, name: str) -> Float[Tensor, "member time mode"]:
        """Return the POD coefficients of one part."""
        return each_state(self.pod.encode, self.states(name))

    def noisy_windows(self, name: str) -> Float[Tensor, "member time lag sensor"]:
        """Return windows of noisy histories; the seed and the part determine the noise."""
        traces = self.observed(name)
        generator = torch.Generator().manual_seed(self.seed * 2 + (name == "test"))
        noise = torch.randn(traces.shape, generator=generator, dtype=traces.dtype)
        return windows(traces + self.noise * noise, self.lags)

    def train_dataloader(self) -> Batches:
        """Return noise-free sequences of ``k + 1`` samples with targets for their second half.

        The third tensor is the number of leading samples that repeat the first sample of a
        trajectory. One pass of the LSTM trains on all targets of a sequence, at a tenth of the
        cost of separate windows. In use, the network has a full history of k samples, longer than
        the shortest one in training. The LightningModule adds the noise. Sequences overlap; the
        last one of each member, which overlaps with no later one, is repeated instead.
        """
        half = self.lags // 2
        sequences, coefficients = (
            windows(self.observed("train"), self.lags),
            self.coefficients("train"),
        )
        last = sequences.shape[1] - 1
        ends = torch.tensor([*range(0, last, max(1, half // 2)), *[last] * (1 + LAST_REPEATS)])
        # Where the first sample of a trajectory is repeated, so is its state.
        at = (ends[:, None] + torch.arange(-half, 1)).clamp(min=0)
        repeated = (self.lags - ends).clamp(min=0).repeat(len(sequences))
        tensors = _flat(sequences[:, ends]), _flat(coefficients[:, at]), repeated
        return shuffled_batches(tensors, self.batch, self.seed, Share.of(self.trainer))

    def val_dataloader(self) -> Batches:
        """Return noisy windows and coefficients of the validation members."""
        noisy, coefficients = self.noisy_windows("validation"), self.coefficients("validation")
        tensors = _flat(noisy), _flat(coefficients)
        return ordered_batches(tensors, VALIDATION_BATCH, Share.of(self.trainer))


def _flat(values: Tensor) -> Tensor:
    return values.flatten(0, 1).float().contiguous()
