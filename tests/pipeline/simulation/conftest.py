"""Settings of a short run, and runs of a simulator that lacks a term."""

from __future__ import annotations

from pathlib import Path

from torch import Tensor

from dashred.config import load_config
from dashred.pipeline.input.build_problem import build_problem
from dashred.pipeline.problem import Problem
from dashred.pipeline.simulation.nominal_run import NominalRun, simulate_nominal
from tests.ring_recording import write_ring_recording

SHORT_RUN = """
shred: {lags: 5, latent: 8, decoder: [16], modes: 3, epochs: 2, steps: 4, batch: 8}
assimilation: {epochs: 2, width: 8}
latent_sindy: {steps: [1, 2], bootstraps: 3, begins: 3}
surrogate: {members: 12}
threads: 1
tracking: {model: false}
"""
SENSORS, NOISE = 8, 0.01
RECORDING = "\nrecording: {path: recording.csv, sensors: sensors.csv}"


def runs_without(
    term: str, system: str, start: tuple[float, float], times: Tensor, folder: Path
) -> tuple[Problem, NominalRun]:
    """Return the runs of a simulator on a ring, beside a recording that has one more term.

    Args:
        term: what the recording has at the place ``MISSING`` of the system.
        system: the ``system`` of a configuration.
        start: mean and amplitude of the initial cosine.
        times: of the samples, ``(time,)``.
        folder: gets the files.
    """
    write_ring_recording(folder, system.replace("MISSING", term), start, times, SENSORS, NOISE)
    path = folder / "case.yaml"
    path.write_text(system.replace("MISSING", "") + RECORDING + SHORT_RUN, encoding="utf-8")
    problem = build_problem(load_config([f"conf={path}"], entry="test"))
    return problem, simulate_nominal(problem, {})
