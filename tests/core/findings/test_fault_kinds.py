"""One table of fault kinds: every kind is searched, worded and can be hidden in a twin."""

import numpy as np
import pytest

from dashred.core.findings.fault_kinds import FAULT_KINDS
from dashred.data.sensors import Sensor
from dashred.evaluation.twins.faulty_sensors import faulty_readings
from dashred.evaluation.twins.sealing import SealedFault
from dashred.inference.sensor_faults.fault_table import SEARCHED_KINDS
from dashred.reporting.text.sensor_faults import fault_text

TIMES = np.linspace(0.0, 10.0, 41)


def test_every_kind_is_searched() -> None:
    assert SEARCHED_KINDS.keys() == FAULT_KINDS.keys()


@pytest.mark.parametrize("kind", FAULT_KINDS)
def test_every_kind_has_a_text(kind: str) -> None:
    text = fault_text(
        {
            "sensor": "s1",
            "fault": kind,
            "value": 2.0,
            "std": 0.1,
            "from": 3.0,
            "reads": None,
            "axis": None,
            "episode": "run2",
            "curve": [{"episode": None, "times": [1.5], "value": [2.0], "std": [0.1]}],
        }
    )
    assert "s1" in text and "{" not in text and text.endswith("in episode 'run2'")


@pytest.mark.parametrize("kind", sorted(FAULT_KINDS.keys() - {"misplaced"}))
def test_every_kind_can_be_hidden_in_a_twin(kind: str) -> None:
    """A misplaced sensor reads another place instead."""
    sound = np.sin(TIMES)
    read = faulty_readings(sound, TIMES, Sensor("s1", "u"), [SealedFault("s1", kind, 2.0)])
    assert np.abs(read - sound).max() > 0.5
