"""Selection and hash of recordings."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from dashred.core.errors import InputError
from dashred.data.recording import Recording
from dashred.data.sensors import Sensor


def test_select_takes_columns_in_the_order_asked_for(make_recording):
    recording = make_recording(4)
    part = recording.select(["s3", "s1"])
    assert part.names == ("s3", "s1")
    np.testing.assert_array_equal(part.values, recording.values[:, [3, 1]])
    assert recording.select([]).values.shape == (101, 0)


def test_select_refuses_an_unknown_name(make_recording):
    with pytest.raises(InputError, match="did you mean s1"):
        make_recording(2).select(["s1x"])


def test_between_includes_both_ends(make_recording):
    part = make_recording(2, 10, step=0.5).between(1.0, 2.0)
    assert part.times.tolist() == [1.0, 1.5, 2.0]
    assert part.values.shape == (3, 2)


def test_the_hash_depends_on_every_content(make_recording):
    one = make_recording(3)
    changed = one.values.copy()
    changed[5, 1] = np.nan
    others = [
        replace(one, values=changed),
        replace(one, times=one.times + 1),
        replace(one, sensors=(Sensor("z", "u", (0.0,)), *one.sensors[1:])),
        replace(one, sensors=(replace(one.sensors[0], reads="v"), *one.sensors[1:])),
        replace(one, sensors=(replace(one.sensors[0], position=(0.1,)), *one.sensors[1:])),
        replace(one, sensors=(replace(one.sensors[0], std=0.1), *one.sensors[1:])),
    ]
    assert len({one.sha256(), *(other.sha256() for other in others)}) == 7
    assert make_recording(3).sha256() == one.sha256()


def test_missing_values_hash_alike_whatever_their_bits(make_recording):
    first, second = make_recording(1), make_recording(1)
    first.values[0] = np.nan
    second.values[0] = -np.float64(np.nan)
    assert first.sha256() == second.sha256()


def test_a_recording_that_does_not_fit_itself_cannot_be_made():
    sensor = (Sensor("a", "u"),)
    with pytest.raises(ValueError, match="do not fit"):
        Recording(sensor, np.arange(3.0), np.zeros((3, 2)))
    with pytest.raises(ValueError, match="increase"):
        Recording(sensor, np.array([0.0, 1.0, 1.0]), np.zeros((3, 1)))
