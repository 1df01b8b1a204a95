"""Folders of finished runs of the oscillator in `tests.support.streams`, without an analysis."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import torch

from dashred.core.findings.findings import freeze, write_json_atomic
from dashred.data.recording import Recording
from dashred.models.pod import POD
from dashred.models.scaler import Scaler
from dashred.models.shred import SHRED
from dashred.pipeline.outputs.estimator_file import write_estimator
from dashred.pipeline.outputs.field_files import write_estimates
from tests.support import streams

LAGS, SAMPLES = 4, 150


def shred() -> SHRED:
    """Return a small network with random weights."""
    torch.manual_seed(0)
    states = torch.from_numpy(streams.climate())
    pod, scaler = POD.fit(states, 2), Scaler.fit(states)
    spread = pod.encode(states).std(dim=0)
    return SHRED(scaler, pod, spread, latent=4, layers=1, decoder=[4]).float()


def finished_run(folder: Path) -> Path:
    """Write what a finished run has written, as far as ``dashred follow`` reads it."""
    folder.mkdir(parents=True)
    text = streams.TEXT.replace("LAW", "0").replace("{twin: a, sensors: 2, noise: 0, ", "{")
    (folder / "corrected.yaml").write_text(text.replace("duration: 12, ", ""))
    times, values = streams.readings(SAMPLES, seed=1)
    states = torch.from_numpy(streams.climate())
    clock = streams.EVERY * torch.arange(len(states), dtype=torch.float64)
    for name, part in {"estimates.nc": slice(0, 200), "forecast.nc": slice(200, 300)}.items():
        write_estimates(folder / name, streams.system(), clock[part], {"corrected": states[part]})
    names = [sensor.name for sensor in streams.SENSORS]
    write_estimator(
        folder / "estimator.nc",
        Recording(streams.SENSORS, times, values),
        [],
        dict.fromkeys(names, "input"),
        dict.fromkeys(names, streams.SIGMA),
        shred(),
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
