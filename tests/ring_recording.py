"""Write the recording of a ring whose complete equations are known."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import torch
from torch import Tensor

from dashred.config import load_config
from dashred.physics.solvers.simulate import simulate
from dashred.physics.system import System

TWIN = "recording: {twin: a, sensors: 1, noise: 0, duration: 4, every: 0.1}\n"


def write_ring_recording(
    folder: Path,
    equations: str,
    start: tuple[float, float],
    times: Tensor,
    count: int,
    noise: float,
) -> None:
    """Write ``recording.csv`` and ``sensors.csv`` of a system with one field on a ring.

    Args:
        folder: gets the files.
        equations: the ``system`` of a configuration, with all terms.
        start: mean and amplitude of the initial cosine.
        times: of the samples, ``(time,)``.
        count: number of sensors at equal distances.
        noise: σ of the readings.
    """
    (folder / "truth.yaml").write_text(equations + TWIN, encoding="utf-8")
    config = load_config([f"conf={folder / 'truth.yaml'}"], entry="test")
    system = System(config.system, config.where)
    [axis], [field] = system.axes, system.fields
    x, (mean, amplitude) = system.grid.coordinates[axis.name], start
    first = mean + amplitude * torch.cos(2 * torch.pi * x / axis.length)
    states = simulate(system, first[None, None], times)[0, :, 0].numpy()
    places = np.linspace(0, axis.length, count + 1)[:-1] + 0.3
    exact = np.stack([np.interp(places, x.numpy(), row, period=axis.length) for row in states])
    readings = exact + noise * np.random.default_rng(1).standard_normal(exact.shape)
    names = [f"s{i}" for i in range(count)]
    table, header = np.column_stack([times.numpy(), readings]), ",".join(["time", *names])
    np.savetxt(folder / "recording.csv", table, delimiter=",", header=header, comments="")
    rows = [f"{name},{field},{place}" for name, place in zip(names, places, strict=True)]
    text = "\n".join([f"name,field,{axis.name}", *rows]) + "\n"
    (folder / "sensors.csv").write_text(text, encoding="utf-8")
