"""Folders of finished runs of the examples of streams, without an analysis."""

from __future__ import annotations

from pathlib import Path
from typing import Protocol, cast

import numpy as np
import torch

from dashred.core.findings.findings import freeze, write_json_atomic
from dashred.data.recording import Recording
from dashred.data.sensors import Sensor
from dashred.models.pod import POD
from dashred.models.scaler import Scaler
from dashred.models.shred import SHRED
from dashred.physics.system import System
from dashred.pipeline.outputs.estimator_file import write_estimator
from dashred.pipeline.outputs.field_files import write_estimates
from tests.support import streams

LAGS, SAMPLES = 4, 150


class Example(Protocol):
    """A module with a system and its streams."""

    TEXT: str
    SENSORS: tuple[Sensor, ...]
    EVERY: float
    SIGMA: float

    def system(self) -> System:
        """Return the simulator with its true law, without inputs."""

    def climate(self) -> np.ndarray:
        """Return states that it may be in, ``(state, field)``."""

    def recording(self, samples: int) -> Recording:
        """Return the recording of the run."""


OSCILLATOR = cast(Example, streams)


def shred(example: Example = OSCILLATOR) -> SHRED:
    """Return a small network with random weights."""
    torch.manual_seed(0)
    states = torch.from_numpy(example.climate())
    pod, scaler = POD.fit(states, 2), Scaler.fit(states)
    spread = pod.encode(states).std(dim=0)
    return SHRED(scaler, pod, spread, latent=4, layers=1, decoder=[4]).float()


def finished_run(folder: Path, example: Example = OSCILLATOR) -> Path:
    """Write what a finished run has written, as far as ``dashred follow`` reads it."""
    folder.mkdir(parents=True)
    system, recording = example.system(), example.recording(SAMPLES)
    (folder / "corrected.yaml").write_text(example.TEXT.replace("LAW", "0"))
    states = torch.from_numpy(example.climate())
    clock = example.EVERY * torch.arange(len(states), dtype=torch.float64)
    for name, part in {"estimates.nc": slice(0, 200), "forecast.nc": slice(200, 300)}.items():
        write_estimates(folder / name, system, clock[part], {"corrected": states[part]})
    names = [sensor.name for sensor in recording.sensors]
    write_estimator(
        folder / "estimator.nc",
        recording,
        [],
        dict.fromkeys(names, "input"),
        dict.fromkeys(names, example.SIGMA),
        shred(example),
        LAGS,
    )
    findings = {"corrected": "corrected.yaml", "causes": [], "verdict": "missing-term"}
    write_json_atomic(folder / "findings.json", findings)
    freeze(folder, ["corrected.yaml", "estimates.nc", "forecast.nc", "estimator.nc"])
    return folder


def write_stream(path: Path, times: np.ndarray, values: np.ndarray) -> Path:
    """Write a stream as a CSV."""
    lines = ["time,place,momentum"]
    rows = zip(times.tolist(), values.tolist(), strict=True)
    for time, sample in rows:
        lines.append(",".join([f"{time:.10g}", *("" if x != x else repr(x) for x in sample)]))
    path.write_text("\n".join(lines) + "\n")
    return path
