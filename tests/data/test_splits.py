"""Splits: roles of the sensors, and fit, validation and held-out times."""

from __future__ import annotations

import numpy as np
import pytest

from dashred.config import SensorSplit, Splits, TimeSplit
from dashred.core.errors import InputError
from dashred.data.recording import Recording
from dashred.data.sensors import Sensor
from dashred.data.splits import check_read, split_recording


def wanted(validate=2, test=3, extra=None, time=0.2):
    return Splits(SensorSplit(validate, test, extra), TimeSplit(time))


def test_every_sensor_has_one_role_and_counts_are_kept(make_recording):
    recording = make_recording(17)
    split = split_recording(recording, wanted(), seed=1)
    roles = [*split.inputs, *split.extra, *split.validate, *split.test]
    assert sorted(roles) == sorted(recording.names)
    counts = [len(r) for r in (split.inputs, split.extra, split.validate, split.test)]
    assert counts == [8, 4, 2, 3]
    parts = {"input": split.inputs, "extra": split.extra, "validate": split.validate}
    parts["test"] = split.test
    assert split.roles == {name: role for role, names in parts.items() for name in names}


def test_parts_hold_the_right_sensors_and_times(make_recording):
    recording = make_recording(17)
    split = split_recording(recording, wanted(), seed=1)
    fitted = {*split.inputs, *split.extra}
    assert set(split.fit.names) == fitted
    assert split.validation.names == split.validate
    assert split.tested.names == split.test
    assert set(split.heldout.names) == fitted | set(split.validate)
    assert split.time_end == split.fit_end == pytest.approx(8.0)
    np.testing.assert_array_equal(split.fit.times, recording.times[:81])
    np.testing.assert_array_equal(split.validation.times, recording.times[:81])
    np.testing.assert_array_equal(split.heldout.times, recording.times[81:])
    np.testing.assert_array_equal(split.tested.times, recording.times)


def test_the_end_is_not_decided_by_rounding():
    for step in (0.1, 0.3, 1 / 3, 0.7, 1e-3):
        times = 7.0 + step * np.arange(101, dtype=np.float64)
        recording = Recording((Sensor("a", "u"),), times, np.ones((101, 1)))
        assert len(split_recording(recording, wanted(time=0.3), 0).fit.times) == 71


def test_the_seed_alone_decides(make_recording):
    def drawn(seed):
        split = split_recording(make_recording(17), wanted(), seed)
        return split.validate, split.test, split.extra

    assert drawn(4) == drawn(4)
    assert len({drawn(seed) for seed in range(8)}) > 4


@pytest.mark.parametrize("seed", range(10))
def test_held_out_sensors_are_not_neighbours(make_recording, seed):
    recording = make_recording(17)
    split = split_recording(recording, wanted(), seed)
    places = [recording.names.index(name) for name in (*split.validate, *split.test)]
    apart = np.abs(np.subtract.outer(places, places))
    round_the_ring = np.minimum(apart, 17 - apart)[np.triu_indices(5, 1)]
    assert round_the_ring.min() >= 2


def test_held_out_sensors_spread_over_a_plane():
    sites = [(float(x), float(y)) for x in range(7) for y in range(7)]
    sensors = tuple(Sensor(f"s{i}", "u", site) for i, site in enumerate(sites))
    recording = Recording(sensors, np.arange(30.0), np.ones((30, 49)))
    for seed in range(5):
        split = split_recording(recording, wanted(), seed)
        chosen = np.array([sites[recording.names.index(n)] for n in (*split.validate, *split.test)])
        apart = np.abs(chosen[:, None] - chosen[None, :])
        apart = np.linalg.norm(np.minimum(apart, 7 - apart), axis=-1)
        assert apart[np.triu_indices(5, 1)].min() >= 2


def test_named_sensors_keep_their_roles(make_recording):
    split = split_recording(make_recording(12), wanted(["s3"], ["s7", "s0"], 0), seed=1)
    assert split.validate == ("s3",)
    assert split.test == ("s0", "s7")
    assert split.extra == ()
    assert len(split.inputs) == 9


def test_names_and_numbers_go_together(make_recording):
    split = split_recording(make_recording(12), wanted(["s3"], 3), seed=1)
    assert split.validate == ("s3",)
    assert len(split.test) == 3
    assert not {"s2", "s3", "s4"} & set(split.test)


def test_few_sensors_hold_out_time_alone(make_recording):
    split = split_recording(make_recording(4), wanted(), seed=1)
    assert (split.validate, split.test, split.extra) == ((), (), ())
    assert set(split.roles.values()) == {"input"}
    assert split.tested.values.shape == (101, 0)
    assert split.fit_end == pytest.approx(6.4)
    np.testing.assert_allclose(split.validation.times, np.arange(65, 81) * 0.1)
    assert split.validation.names == split.fit.names
    assert len(split.fit.times) == 81
    assert "no sensor is" in split.note
    assert "6.4 < t <= 8 are used for validation" in split.note


@pytest.mark.parametrize(
    ("sensors", "validate", "test"),
    [(5, 0, 1), (6, 1, 1), (7, 1, 2), (8, 2, 2), (9, 2, 3), (12, 2, 3)],
)
def test_four_sensors_at_least_are_fitted(make_recording, sensors, validate, test):
    split = split_recording(make_recording(sensors), wanted(), seed=1)
    assert (len(split.validate), len(split.test)) == (validate, test)
    assert len(split.fit.names) == sensors - validate - test >= 4
    assert ("fewer are held out than the 5 of" in split.note) == (validate + test < 5)


def test_few_sensors_are_held_out_when_named(make_recording):
    split = split_recording(make_recording(3), wanted(3, ["s1"]), seed=1)
    assert split.test == ("s1",)
    assert split.validate == ()
    assert len(split.inputs) == 2


def test_extra_sensors_by_default_and_by_number(make_recording):
    assert split_recording(make_recording(10), wanted(), 0).extra == ()
    assert len(split_recording(make_recording(11), wanted(), 0).extra) == 2
    assert len(split_recording(make_recording(10), wanted(extra=4), 0).extra) == 4


@pytest.mark.parametrize(
    ("sensors", "splits", "message"),
    [
        (2, wanted(["s0"], ["s1"]), "all 2 sensors are held out"),
        (12, wanted(["s3"], ["s3"]), "'s3' occurs twice"),
        (12, wanted(["s33"]), "did you mean s3"),
        (12, wanted(extra=7), "leave none of the 7 fit sensors"),
    ],
)
def test_impossible_splits_are_refused(make_recording, sensors, splits, message):
    with pytest.raises(InputError, match=message):
        split_recording(make_recording(sensors), splits, 0)


def test_a_sensor_that_starts_too_late_is_refused(make_recording):
    recording = make_recording(8)
    recording.values[:90, 2] = np.nan
    split = split_recording(recording, wanted(1, 1), 0)
    with pytest.raises(InputError, match="'s2' has no value until t = 8"):
        check_read([split])
    check_read([split, split_recording(make_recording(8), wanted(1, 1), 0)])
