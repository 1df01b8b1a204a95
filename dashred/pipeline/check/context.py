"""What a check looks at: the simulator, and sensors over a time."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import torch
from torch import Tensor

from dashred.config import Config
from dashred.core.errors import InputError
from dashred.data.episodes import Episodes
from dashred.data.inputs import drive_signals, with_inputs
from dashred.data.recording import Recording
from dashred.data.sensor_layout import place_sensors
from dashred.data.sensors import Sensor
from dashred.data.splits import Split, split_recording
from dashred.physics.library import build_library
from dashred.physics.system import System, Term
from dashred.pipeline.problem import Problem, build_problem, read_recorded

# Places like a twin's: they come from a stream of the check's own, and tell nothing of any twin's.
STREAM = 0xC4EC
# A twin without noise is checked as one of so little.
LEAST_NOISE = 1e-6


@dataclass(frozen=True)
class CheckContext:
    """A simulator and the sensors that shall tell what it leaves out.

    Attributes:
        system: under its inputs.
        library: candidate terms.
        times: the analysis clock, ``(time,)``.
        split: roles of the sensors. Without a recording it is one of nothing but zeros.
        recording: the user's own, as it was read, or the longest of its episodes that are fitted;
            None while there is none.
        others: the other episodes by name, one that is held out whole among them.
        clock: how the clock came about.
        noise: σ by sensor; empty while there is no recording.
        problem: what a run would start from; None while there is no recording.
    """

    config: Config
    system: System
    library: list[Term]
    times: Tensor
    split: Split
    recording: Recording | None
    others: dict[str, Recording]
    clock: str
    noise: dict[str, float]
    problem: Problem | None = None

    @property
    def sensors(self) -> tuple[Sensor, ...]:
        """The sensors that a fit may look at: to fit and to validate."""
        every = (*self.split.fit.sensors, *self.split.validation.sensors)
        return tuple({sensor.name: sensor for sensor in every}.values())

    def sigma(self, states: Tensor) -> Tensor:
        """Return σ of these sensors, ``(sensor,)``; of a twin's by the simulator's own fields.

        Args:
            states: the nominal simulation, ``(time, field, *grid)``.
        """
        if self.noise:
            return torch.tensor([self.noise[s.name] for s in self.sensors], dtype=torch.float64)
        share = max(self.config.recording.noise, LEAST_NOISE)
        sizes = {s.reads: float(self.system.evaluate(s.reads, states).std()) for s in self.sensors}
        return torch.tensor([share * sizes[s.reads] for s in self.sensors], dtype=torch.float64)


def check_context(config: Config, recorded: Episodes | None = None) -> CheckContext:
    """Read what there is.

    Args:
        config: the system, and how it is analysed.
        recorded: the recording; None reads the one that ``recording.path`` names, if it names one.

    Raises:
        InputError: whatever a run would refuse about equations, library, recording or splits.
    """
    if recorded is None and config.recording.path is None:
        return _without_recording(config)
    if recorded is None:
        recorded = read_recorded(config, System(config.system, config.where))
    posed = build_problem(config, recorded)
    recordings = {episode.name: episode.recording for episode in recorded.episodes}
    return CheckContext(
        config,
        posed.system,
        posed.library,
        posed.times,
        posed.split,
        recordings.pop(posed.name),
        recordings,
        posed.clock,
        posed.noise,
        posed,
    )


def _without_recording(config: Config) -> CheckContext:
    """Return the layout that the configuration asks for; nobody's truth has a part in it."""
    bare = System(config.system, config.where)
    library = build_library(bare, config.library)
    every, duration = config.recording.every, config.recording.duration
    if every is None:
        raise InputError(
            "there is no recording, and no step between samples to check sensors at",
            where=config.where("recording"),
            hint="give a recording, or recording.every and recording.duration",
        )
    times = torch.arange(round(duration / every) + 1, dtype=torch.float64) * every
    inputs = drive_signals(bare, config, times)
    system = with_inputs(bare, inputs)
    sensors = place_sensors(system, config, np.random.default_rng([config.seed, STREAM]))
    silent = Recording(tuple(sensors), times.numpy(), np.zeros((len(times), len(sensors))))
    split = split_recording(silent, config.splits, config.seed)
    clock = f"{len(times)} samples at a step of {every:.6g}"
    return CheckContext(config, system, library, times, split, None, {}, clock, {})
