"""Posing the problem: what the analysis starts from, and what it must not have seen."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path

import numpy as np
import pytest
from numpy.typing import NDArray

from dashred.config import load_config
from dashred.core.errors import InputError
from dashred.core.units import NO_UNITS
from dashred.data.io.write_netcdf import write_netcdf
from dashred.data.recording import Recording
from dashred.data.sensors import Sensor
from dashred.inference.fit.law import SensorFault
from dashred.pipeline.input.build_problem import build_problem
from dashred.pipeline.problem import Problem
from dashred.reporting.text.sensor_faults import fault_text


@pytest.fixture
def make_problem(quick, tmp_path):
    """Return a function that builds a problem with six sensors of u and unknown noise."""

    def build(
        values: NDArray[np.float64], *words: str, units: Mapping[str, str] = NO_UNITS
    ) -> Problem:
        path: Path = tmp_path / "recording.nc"
        sensors = tuple(Sensor(f"s{i}", "u", (0.3 + i,), None) for i in range(6))
        write_netcdf(
            Recording(
                sensors, np.linspace(0, 0.1 * (len(values) - 1), len(values)), values, units=units
            ),
            path,
            ["x"],
        )
        return build_problem(
            load_config([f"conf={quick}", f"recording.path={path}", *words], entry="train")
        )

    return build


def traces(samples: int = 60) -> NDArray[np.float64]:
    rng = np.random.default_rng(1)
    smooth = np.sin(0.1 * np.arange(samples))[:, None] + np.arange(6)
    return smooth + 0.05 * rng.standard_normal((samples, 6))


def test_angles_are_continued(make_problem) -> None:
    angle = traces() * 2.5
    wrapped = (angle + np.pi) % (2 * np.pi) - np.pi
    problem = make_problem(wrapped, "recording.angles=[u]", "library=null")
    plain = make_problem(angle, "library=null")
    for found, expected in zip(problem.split.fit.values.T, plain.split.fit.values.T, strict=True):
        turns = (found - expected) / (2 * np.pi)
        np.testing.assert_allclose(turns, np.round(turns[0]), atol=1e-9)
    assert np.abs(np.diff(wrapped, axis=0)).max() > 5
    assert problem.noise == pytest.approx(plain.noise)
    # The sine of an angle is a candidate, that of another quantity is not.
    assert "sin(u)" in {str(term) for term in problem.library}
    assert "sin(u)" not in {str(term) for term in plain.library}


def test_an_estimated_noise_has_not_seen_what_is_held_out(make_problem) -> None:
    values = traces()
    before = make_problem(values)
    late = before.split.time_end + 1e-9 < 0.1 * np.arange(60)
    values[late] += 5 * np.random.default_rng(2).standard_normal((int(late.sum()), 6))
    tested = [int(name[1:]) for name in before.split.test]
    values[:, tested] = 100 * np.random.default_rng(3).standard_normal((60, len(tested)))
    after = make_problem(values)
    assert after.noise == before.noise
    assert after.noise.keys() == {f"s{i}" for i in range(6)} - set(before.split.test)
    assert list(after.noise.values()) == pytest.approx([0.05] * 5, rel=0.5)
    assert after.recording_sha256 != before.recording_sha256


def test_noise_is_estimated_at_the_recordings_own_step(make_problem) -> None:
    every = make_problem(traces(120), "recording.every=0.2")
    assert len(every.times) == 60
    assert list(every.noise.values()) == pytest.approx([0.05] * 5, rel=0.5)


def test_no_stage_can_shift_anothers_draws(make_problem) -> None:
    problem = make_problem(traces())
    draws = {name: problem.rng(name).standard_normal(3).tolist() for name in ("ensemble", "b")}
    assert problem.rng("ensemble").standard_normal(3).tolist() == draws["ensemble"]
    assert draws["ensemble"] != draws["b"]
    other = make_problem(traces(), "seed=5")
    assert other.rng("ensemble").standard_normal(3).tolist() != draws["ensemble"]


def test_units_of_either_side_hold_and_are_told(make_problem) -> None:
    problem = make_problem(traces(), "system.units.x=m", units={"t": "s", "u": "K"})
    assert problem.system.units == {"t": "s", "u": "K", "x": "m"}
    told = {
        "bias": "sensor s1 has a bias of 1.50 ± 0.20 K",
        "drift": "sensor s1 drifts by 1.50 ± 0.20 K per s",
        "stuck": "sensor s1 is stuck at 1.50 ± 0.20 K from t = 3 s on",
        "misplaced": "sensor s1 is 1.50 ± 0.20 m away from its stated position",
    }
    for kind, words in told.items():
        fault = problem.fault_details(SensorFault(kind, "s1", 1.5, 0.1, 3.0))
        assert fault_text(fault, problem.system.units) == words
    with pytest.raises(InputError, match="x is in K here, but in m in command line"):
        make_problem(traces(), "system.units.x=m", units={"x": "K"})
