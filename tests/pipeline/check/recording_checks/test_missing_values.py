"""Remarks on missing values, and remarks that several episodes share."""

from __future__ import annotations

import numpy as np
import pytest

from dashred.data.recording import Recording
from dashred.data.sensors import Sensor
from dashred.pipeline.check.recording_checks.recording import _by_episode
from dashred.pipeline.check.recording_checks.values import missing_remarks
from dashred.pipeline.check.remark import Remark, warning

TIMES = np.arange(60.0)


def recording(missing: np.ndarray) -> Recording:
    values = np.stack([np.sin(TIMES), np.where(missing, np.nan, np.cos(TIMES))], axis=1)
    return Recording((Sensor("u", "u"), Sensor("v", "v")), TIMES, values)


@pytest.mark.parametrize(
    ("missing", "warned"),
    [
        (TIMES % 2 == 0, False),
        (TIMES % 5 != 0, False),
        ((TIMES > 20) & (TIMES < 40), True),
        (TIMES > 45, True),
        (TIMES < 15, True),
        (TIMES == 7, False),
    ],
    ids=["in turn", "slower", "gap", "end", "beginning", "one"],
)
def test_a_sensor_that_lacks_many_values_in_a_row_is_told(
    missing: np.ndarray, warned: bool
) -> None:
    told = list(missing_remarks(recording(missing)))
    assert told[0].text == f"{missing.mean() / 2:.1%} of the values are missing"
    assert [remark.text.rpartition(" ")[2] for remark in told[1:]] == (["v"] if warned else [])


def test_a_sensor_that_only_other_episodes_read_is_no_gap() -> None:
    [told] = missing_remarks(recording(np.ones(60, dtype=bool)))
    assert told == Remark("No values of v")


def test_no_value_is_missing() -> None:
    assert not list(missing_remarks(recording(np.zeros(60, dtype=bool))))


def test_episodes_with_the_same_remark_share_one() -> None:
    remarks = [(str(name), Remark(f"{name}.5% of the values are missing")) for name in range(1, 9)]
    remarks.insert(3, ("x", warning("a gap of 3 steps", "measure again")))
    first, gap = _by_episode(remarks)
    assert first.text == (
        "Episode 1: 1.5% of the values are missing; similarly in 7 further episodes, "
        "2, 3, 4, 5 and 3 more"
    )
    assert gap.text == "Episode x: a gap of 3 steps" and gap.hint == "measure again"
