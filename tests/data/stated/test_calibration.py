"""Unknown gains and offsets become uncertain parameters of what sensors read."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
import torch

from dashred.config import Splits, TimeSplit
from dashred.config.schema.recording import SensorSplit
from dashred.core.errors import InputError
from dashred.core.stated.calibration import StatedPart, parse_calibration
from dashred.data.episodes import Episode, Episodes
from dashred.data.recording import Recording
from dashred.data.sensors import Sensor
from dashred.data.splits import split_recording
from dashred.data.stated.calibration import with_calibration
from tests import laws

TEXT = """
system:
  title: a tank
  fields: {h: level}
  parameters: {k: 0.5}
  let: {flow: k*h}
  equations: {h: -flow}
  start: {h: 1}
  units: {flow: m**3}
  integrator: {dt: 0.1}
recording: {path: a.csv}
"""
TIMES = np.arange(20.0)


def recorded(count: int = 1) -> Episodes:
    sensors = (Sensor("level 1", "h"), *(Sensor(f"f{i}", "flow") for i in range(count)))
    values = np.full((len(TIMES), len(sensors)), 2.0)
    return Episodes((Episode("", Recording(sensors, TIMES, values)),))


def test_gain_and_offset_are_parameters_of_a_let(tmp_path: Path) -> None:
    system, episodes = laws.declared(tmp_path, TEXT), recorded()
    stated = {"level 1": {"gain": 0.1}, "flow": {"gain": "fitted", "offset": {"value": 0.3}}}
    parts = [episodes.episodes[0].recording]
    found = with_calibration(system, episodes, parts, stated, str)
    config = found.system.config
    assert config.parameter_spread == {
        "gain_of_level_1": 0.1,
        "gain_of_f0": 1.0,
        "offset_of_f0": pytest.approx(6.0),
    }
    assert config.parameters["offset_of_f0"] == 0.3 and config.units["offset_of_f0"] == "m**3"
    level, flow = found.episodes.sensors
    assert level.is_calibrated and flow.is_calibrated and level.reads == "level_1_reading"
    state = torch.tensor([[4.0]], dtype=torch.float64)
    assert float(found.system.evaluate(flow.reads, state)) == pytest.approx(0.5 * 4 + 0.3)
    assert found.parameters["gain_of_level_1"] == "level 1"


def test_without_the_key_nothing_changes(tmp_path: Path) -> None:
    system, episodes = laws.declared(tmp_path, TEXT), recorded()
    found = with_calibration(system, episodes, [], None, str)
    assert found.system is system and found.episodes.sensors == episodes.sensors


def test_calibrated_sensors_are_fitted(tmp_path: Path) -> None:
    system, episodes = laws.declared(tmp_path, TEXT), recorded(7)
    parts = [episodes.episodes[0].recording]
    stated = {name: {"gain": 0.1} for name in ("f1", "f3", "f5", "f6", "f0")}
    found = with_calibration(system, episodes, parts, stated, str)
    recording = found.episodes.episodes[0].recording
    splits = Splits(SensorSplit(2, 3, 0), TimeSplit(0.2))
    split = split_recording(recording, splits, 0)
    assert set(stated) <= set(split.fit.names)
    assert len(split.fit.names) == 5 and len((*split.validate, *split.test)) == 3
    named = Splits(SensorSplit(["f1"], 0, 0), TimeSplit(0.2))
    with pytest.raises(InputError, match="its calibration is fitted"):
        split_recording(recording, named, 0)


def test_the_parts_of_a_calibration() -> None:
    stated = {"a": {"gain": "fitted"}, "b": {"gain": {"value": 12, "spread": 2}, "offset": 0.5}}
    assert parse_calibration(stated, str) == {
        "a": {"gain": StatedPart(1.0, None)},
        "b": {"gain": StatedPart(12.0, 2.0), "offset": StatedPart(0.0, 0.5)},
    }
    assert parse_calibration(None, str) == {}


@pytest.mark.parametrize(
    ("stated", "what"),
    [
        ("fitted", "must be a section"),
        ({"a": 0.1}, "must be a section"),
        ({"a": {"gian": 0.1}}, "unknown key recording.calibration.a.gian"),
        ({"a": {"gain": {"spred": 1}}}, "unknown key recording.calibration.a.gain.spred"),
        ({"a": {"gain": 0}}, "must be fitted or a positive spread"),
        ({"a": {"offset": "unknown"}}, "must be fitted or a positive spread"),
        ({"a": {"gain": {"value": 0}}}, "must be a number other than 0"),
    ],
)
def test_anything_else_is_refused(stated: object, what: str) -> None:
    with pytest.raises(InputError, match=what):
        parse_calibration(stated, str)


def test_a_name_that_no_sensor_has(tmp_path: Path) -> None:
    with pytest.raises(InputError, match="'g', but no sensor has or reads") as refused:
        stated = {"g": {"gain": 0.1}}
        with_calibration(laws.declared(tmp_path, TEXT), recorded(), [], stated, str)
    assert refused.value.where == "recording.calibration.g.gain"
