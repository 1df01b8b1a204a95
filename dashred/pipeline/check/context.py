"""Input of a check: the simulator, the sensors and the clock."""

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
from dashred.data.stated.known_factor import with_even_noise
from dashred.physics.system import System, Term
from dashred.physics.terms.library import build_library
from dashred.pipeline.input.build_problem import build_problem
from dashred.pipeline.input.read_recorded import read_recorded
from dashred.pipeline.input.readings_of_state import readings_of_state
from dashred.pipeline.problem import Problem

# Random stream for sensor positions. It is separate from the twins' streams, so that a check says
# nothing about the sensors of a twin.
STREAM = 0xC4EC
# Smallest noise, as a share of the standard deviation, so that σ is positive without noise.
LEAST_NOISE = 1e-6


@dataclass(frozen=True)
class CheckContext:
    """The simulator, the sensors and the clock that a run would use.

    Attributes:
        config: the configuration.
        system: the simulator with its inputs.
        library: candidate terms.
        times: the analysis clock, ``(time,)``.
        split: roles of the sensors; without a recording, all values are zero.
        recording: the recording as read, or its longest fitted episode; None without a recording.
        others: the other episodes by name, including a held-out episode.
        clock: description of the analysis clock.
        noise: σ by sensor; empty without a recording.
        problem: the problem that a run would solve; None without a recording.
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
        """Sensors for fit and validation."""
        every = (*self.split.fit.sensors, *self.split.validation.sensors)
        return tuple({sensor.name: sensor for sensor in every}.values())

    def sigma(self, states: Tensor) -> Tensor:
        """Return σ of these sensors, ``(sensor,)``; without a recording, from the simulated fields.

        Args:
            states: the nominal run, ``(time, field, *grid)``.
        """
        if self.noise:
            return torch.tensor([self.noise[s.name] for s in self.sensors], dtype=torch.float64)
        share = max(self.config.recording.noise, LEAST_NOISE)
        sizes = {s.reads: float(self.system.evaluate(s.reads, states).std()) for s in self.sensors}
        return torch.tensor([share * sizes[s.reads] for s in self.sensors], dtype=torch.float64)


def build_check_context(config: Config, recorded: Episodes | None = None) -> CheckContext:
    """Read the configuration and its recording.

    Args:
        config: the system, and how it is analysed.
        recorded: the recording; None reads the one that ``recording.path`` names, if it names one.

    Raises:
        InputError: a run would refuse the equations, library, recording or splits.
    """
    if recorded is None and config.recording.path is None:
        return _without_recording(config)
    if recorded is None:
        recorded = read_recorded(config, System(config.system, config.where))
    problem = build_problem(config, recorded)
    bare = System(config.system, config.where)
    found = readings_of_state(config, bare, recorded)
    recordings = {
        name: with_even_noise(own, with_inputs(found.system, own.inputs))
        for name, own in ((part.name, part.recording) for part in found.episodes.episodes)
    }
    return CheckContext(
        config,
        problem.system,
        problem.library,
        problem.times,
        problem.split,
        recordings.pop(problem.name),
        recordings,
        problem.clock,
        problem.noise,
        problem,
    )


def _without_recording(config: Config) -> CheckContext:
    """Return the context of a configured sensor layout; it does not depend on a twin's truth."""
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
