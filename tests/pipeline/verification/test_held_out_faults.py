"""A faulty test sensor is told; sound ones are not, and the fit is not touched."""

from __future__ import annotations

import math
from dataclasses import replace
from pathlib import Path
from types import SimpleNamespace
from typing import Any, cast

import numpy as np
import pytest
import torch

from dashred.config import SensorSplit, Splits, TimeSplit, load_config
from dashred.data.observation_operator import ObservationOperator
from dashred.data.recording import Recording
from dashred.data.sensors import Sensor
from dashred.data.splits import split_recording
from dashred.inference.fit.noise_model import NoiseModel
from dashred.inference.forward.episodes import EpisodeStarts
from dashred.inference.results.verdict import describe_fault, with_faults
from dashred.physics.runs.initial_state_prior import StartPrior, field_rms, nominal_start
from dashred.physics.solvers.simulate import simulate
from dashred.physics.system import System
from dashred.pipeline.input.build_problem import build_problem
from dashred.pipeline.problem import Problem
from dashred.pipeline.verification.held_out_faults import (
    _relative_noise_of,
    err_next_to,
    held_out_faults,
)
from tests import laws

TEXT = """
system:
  title: Warm ring
  axes: {x: {length: 8, points: 24}}
  fields: {w: warmth}
  equations: {w: "-0.5*d(w, x) + 0.15*lap(w)"}
  start: {w: 0.2 + 0.8*cos(2*pi*x/8)}
  spread: {w: 0.2, length: 3}
  integrator: {dt: 0.05}
recording: {path: recording.csv, sensors: sensors.csv}
"""
NAMES = [f"q{j}" for j in range(10)]
PLACES = [0.3 + 0.8 * j for j in range(10)]
TIMES = 0.1 * torch.arange(51, dtype=torch.float64)
SIGMA = 0.02


def build(folder: Path, faulty: str | None) -> tuple[Problem, Any]:
    """Return the problem of a recording in which nothing is missing, and a stand-in analysis."""
    system = laws.declared(
        folder,
        TEXT.replace(
            "path: recording.csv, sensors: sensors.csv",
            "twin: a, sensors: 4, noise: 0, duration: 4, every: 0.1",
        ),
    )
    start = nominal_start(system)
    sensors = [Sensor(name, "w", (x,)) for name, x in zip(NAMES, PLACES, strict=True)]
    states = simulate(system, start, TIMES)[0]
    values = ObservationOperator(sensors, system)(states).numpy()
    values = values + SIGMA * np.random.default_rng(4).standard_normal(values.shape)
    if faulty is not None:
        share = (TIMES / TIMES[-1]).numpy()
        values[:, NAMES.index(faulty)] += 0.3 * np.sin(2 * math.pi * share)
    table = "".join(f"{n},w,{x},{SIGMA}\n" for n, x in zip(NAMES, PLACES, strict=True))
    (folder / "sensors.csv").write_text("name,field,x,std\n" + table)
    rows = [",".join(f"{v:.6f}" for v in (t, *row)) for t, row in zip(TIMES, values, strict=True)]
    (folder / "recording.csv").write_text("\n".join([",".join(["time", *NAMES]), *rows]) + "\n")
    (folder / "case.yaml").write_text(TEXT)
    words = [
        f"conf={folder / 'case.yaml'}",
        f"recording.path={folder / 'recording.csv'}",
        f"recording.sensors={folder / 'sensors.csv'}",
    ]
    problem = build_problem(load_config(words, entry="train"))
    return problem, stand_in(problem, system, start)


def stand_in(problem: Problem, system: System, start: torch.Tensor) -> Any:
    """Return what the verification reads of an analysis in which nothing is missing."""
    fitted = len(problem.split.fit.names)
    seen = torch.ones((len(problem.split.fit.times), fitted), dtype=torch.bool)
    std = torch.full((fitted,), SIGMA, dtype=torch.float64)
    law = replace(laws.law(), start=start)
    prior = EpisodeStarts((StartPrior(system, start[0], field_rms(start), None),))
    noise = NoiseModel(std, torch.zeros_like(std), seen)
    discovery = SimpleNamespace(best=law, forcing_gain=0.0, noise=noise)
    return SimpleNamespace(discovery=discovery, nominal=SimpleNamespace(start=prior))


def test_a_wandering_test_sensor_is_told(tmp_path: Path) -> None:
    held_out = build(tmp_path, None)[0].split.test[0]
    problem, analysis = build(tmp_path, held_out)
    [fault] = held_out_faults(problem, cast(Any, analysis))
    assert (fault.sensor, fault.kind) == (held_out, "wandering")
    kind, causes = with_faults("nothing-missing", [], [describe_fault(fault)])
    assert kind == "sensor-fault" and causes[0]["sensor"] == held_out


def test_sound_test_sensors_are_not_told(tmp_path: Path) -> None:
    problem, analysis = build(tmp_path, None)
    assert held_out_faults(problem, cast(Any, analysis)) == []
    assert with_faults("missing-term", [], []) == ("missing-term", [])


@pytest.mark.parametrize("gain", [0.0, 9.0])
def test_a_model_that_lacks_something_judges_no_sensor(tmp_path: Path, gain: float) -> None:
    problem, analysis = build(tmp_path, build(tmp_path, None)[0].split.test[0])
    analysis.discovery.forcing_gain = gain
    assert bool(held_out_faults(problem, cast(Any, analysis))) == (gain == 0.0)


def test_beside_another_start_no_slow_error_is_told(tmp_path: Path) -> None:
    """What the modes of a start leave at a sensor that was not fitted varies slowly as well."""
    problem, analysis = build(tmp_path, build(tmp_path, None)[0].split.test[0])
    analysis.discovery.best = replace(analysis.discovery.best, start_prior_factor=8.0)
    assert held_out_faults(problem, cast(Any, analysis)) == []


def test_a_sensor_that_errs_next_to_a_fitted_one_is_told_apart_from_a_distant_one(
    tmp_path: Path,
) -> None:
    problem, _ = build(tmp_path, None)
    held_out = [*problem.split.validate, *problem.split.test]
    [place] = [j for j, name in enumerate(NAMES) if name == held_out[0]]

    def fault(name: str, kind: str = "bias") -> Any:
        return SimpleNamespace(sensor=name, kind=kind)

    other = [fault(held_out[0])]
    assert err_next_to(problem, [fault(NAMES[place - 1])], other)
    assert not err_next_to(problem, [fault(NAMES[(place + 5) % 10])], other)
    assert not err_next_to(problem, [fault(NAMES[place - 1], "stuck")], other)
    assert not err_next_to(problem, [], other) and not err_next_to(problem, other, [])


@pytest.mark.parametrize("validate", [0, 1])
def test_the_noise_of_all_sensors_covers_the_fit_window(validate: int) -> None:
    """Without validation sensors, the validation data are the last samples of the fitted ones."""
    sensors = tuple(Sensor(f"s{i}", "u", (float(i),)) for i in range(6))
    recording = Recording(sensors, np.arange(20.0), np.ones((20, 6)))
    split = split_recording(recording, Splits(SensorSplit(validate, 1, None), TimeSplit(0.2)), 0)
    sizes = SimpleNamespace(split=split, relative_noise=lambda part: 2 * part.values)
    found = _relative_noise_of(cast(Problem, sizes))
    assert found is not None and found.shape == (len(split.fit.times), 6)
    assert (found == 2).all()
