"""Alarms are told in sentences, whatever the number of sensors."""

from __future__ import annotations

import pytest

from dashred.inference.streaming.tracker import Alarm, Kind
from dashred.pipeline.follow.words import alarm_text

NAMES = ("s1", "s2", "s3")


@pytest.mark.parametrize(
    ("kind", "sensors", "told"),
    [
        ("begun", (), "the sum of all sensors differs from the filter"),
        ("begun", (0,), "s1 differs from the filter"),
        ("begun", (0, 1), "s1 and s2 differ from the filter"),
        ("several", (), "the sum of all sensors differs from the corrected simulator"),
        ("several", (1,), "s2 and the sum of all sensors differ from the corrected simulator"),
        ("several", (1, 2), "s2 and s3 differ from the corrected simulator"),
        ("only", (0,), "s1 differs from the corrected simulator. With one sensor"),
        ("sensor", (2,), "s3 differs from what the other sensors say"),
    ],
)
def test_an_alarm_names_its_sensors(kind: Kind, sensors: tuple[int, ...], told: str) -> None:
    text = alarm_text(Alarm(kind, sensors, 3.0, 2.0), NAMES, is_at_begin=False)
    assert text.startswith(f"ALARM at t = 3, since t = 2: {told}")


@pytest.mark.parametrize("kind", ["several", "only"])
def test_readings_that_never_agreed_may_be_of_another_system(kind: Kind) -> None:
    text = alarm_text(Alarm(kind, (0,), 3.0, 2.0), NAMES, is_at_begin=True)
    assert text.endswith("Do they come from another system, or have other units?")


@pytest.mark.parametrize(("sensors", "who"), [((), "the readings"), ((1,), "s2")])
def test_the_end_of_an_alarm(sensors: tuple[int, ...], who: str) -> None:
    text = alarm_text(Alarm("ended", sensors, 3.0, 3.0), NAMES, is_at_begin=False)
    assert text == f"the alarm ends at t = 3: {who} as expected again"
