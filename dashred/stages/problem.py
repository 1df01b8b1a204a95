"""Pose the problem: the simulator, its library, the recording and who is held out."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
import torch
from torch import Tensor

from dashred.config import Config
from dashred.discovery.explanation import fault_in_words
from dashred.discovery.law import SensorFault
from dashred.physics.library import build_library
from dashred.physics.system import System, Term
from dashred.sensing.clock import resample
from dashred.sensing.driving import under
from dashred.sensing.noise import noise_std
from dashred.sensing.observation import ObservationOperator
from dashred.sensing.reader import read_recording
from dashred.sensing.recording import Recording
from dashred.sensing.splits import Split, split_recording


@dataclass(frozen=True)
class Problem:
    """Everything the later stages start from.

    Attributes:
        system: the simulator.
        library: candidate terms.
        recording_sha256: hash of the recording as it was read.
        times: analysis clock over the whole recording, ``(time,)``.
        clock: one sentence on how the clock came about.
        split: roles of the sensors, and the parts of the recording.
        noise: stated or estimated σ by sensor name, in the sensor's unit; of the fit and the
            validation sensors, from the fit window: nothing held out has a part in it.
    """

    config: Config
    system: System
    library: list[Term]
    recording_sha256: str
    times: Tensor
    clock: str
    split: Split
    noise: dict[str, float]

    @property
    def ensemble_system(self) -> System:
        """The simulator with the step that is good enough for an ensemble."""
        dt = self.config.simulation.dt
        return self.system if dt is None else self.system.with_step(dt)

    def operator(self, recording: Recording) -> ObservationOperator:
        """Return H of the sensors of a part of the recording."""
        return ObservationOperator(recording.sensors, self.system)

    def noise_of(self, names: tuple[str, ...]) -> Tensor:
        """Return σ of the named sensors, ``(sensor,)``."""
        return torch.tensor([self.noise[name] for name in names], dtype=torch.float64)

    def fault_in_words(self, fault: SensorFault) -> str:
        """Return what is wrong with a sensor, with the units of what it reads."""
        split, system = self.split, self.system
        parts = (split.fit, split.validation, split.tested)
        reads = {s.name: s.reads for part in parts for s in part.sensors}
        place = system.axes[0].name if len(system.axes) == 1 else None
        return fault_in_words(fault, reads.get(fault.sensor), system.units, place)

    def rng(self, stage: str) -> np.random.Generator:
        """Return the random stream of one stage: no stage can shift another's draws."""
        return np.random.default_rng([self.config.seed, *stage.encode()])


def pose(config: Config) -> Problem:
    """Read and check all input.

    Raises:
        InputError: whatever is wrong with the equations, the library, the recording or the split.
    """
    system = System(config.system, config.where)
    library = build_library(system, config.library)
    assert config.recording.path is not None
    table = config.recording.sensors if isinstance(config.recording.sensors, str) else None
    raw = read_recording(config.recording.path, table, system)
    # What either side states holds; where both do, they agree.
    units = {**raw.units, **system.units}
    system = system.declared_as(replace(system.config, units=units))
    system = under(system, raw.inputs)
    recording, clock = resample(raw, config.recording.every)
    split = split_recording(recording, config.splits, config.seed)
    return Problem(
        config=config,
        system=system,
        library=library,
        recording_sha256=raw.sha256(),
        times=torch.from_numpy(recording.times),
        clock=clock,
        split=split,
        noise=_noise(raw, split),
    )


def _noise(raw: Recording, split: Split) -> dict[str, float]:
    seen = raw.select([name for name in raw.names if name not in split.test])
    early = seen.between(float(raw.times[0]), split.time_end)
    return dict(zip(early.names, noise_std(early).tolist(), strict=True))
