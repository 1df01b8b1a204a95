"""Messages become samples on the clock of the run; each fault is said once."""

from __future__ import annotations

import math

import numpy as np
import pytest

from dashred.core.errors import InputError
from dashred.pipeline.follow.alignment import FOREIGN, Alignment, Sample
from dashred.pipeline.follow.remarks import Remarks
from dashred.pipeline.follow.sources.messages import Message

STEP = 0.1


@pytest.fixture
def said() -> list[str]:
    return []


@pytest.fixture
def alignment(said: list[str]) -> Alignment:
    return Alignment(["a", "b"], STEP, Remarks(said.append))


def message(time: float, a: float = 1.0, b: float = 2.0) -> Message:
    return Message(time, {"a": a, "b": b})


def times(samples: list[Sample]) -> list[float]:
    return [round(sample.time, 6) for sample in samples]


def started(alignment: Alignment) -> None:
    """Let the first samples show that both sensors report."""
    alignment.add([message(-0.2), message(-0.1), message(0.0)])


def test_messages_on_the_clock_are_samples_at_once(alignment: Alignment, said: list[str]) -> None:
    first, *rest = alignment.add([message(0.1 * i) for i in range(5)])
    assert first.begins and not any(sample.begins for sample in rest)
    assert times([first, *rest]) == [0.0, 0.1, 0.2, 0.3, 0.4]
    assert all(sample.span == STEP for sample in rest) and not said


def test_missing_samples_have_no_readings(alignment: Alignment, said: list[str]) -> None:
    started(alignment)
    samples = alignment.add([message(0.3), message(0.4), message(0.7)])
    assert times(samples) == [0.1, 0.2, 0.3, 0.4, 0.5, 0.6, 0.7]
    empty = [bool(np.isnan(sample.values).all()) for sample in samples]
    assert empty == [True, True, False, False, True, True, False]
    assert len(said) == 1 and "missing after the time 0" in said[0]


@pytest.mark.parametrize(
    ("time", "word"), [(-0.1, "comes after"), (0.0, "two messages"), (0.03, "closer than the step")]
)
def test_late_doubled_and_close_messages_are_left_out(
    time: float, word: str, alignment: Alignment, said: list[str]
) -> None:
    started(alignment)
    assert not alignment.add([message(time), message(time)])
    assert times(alignment.add([message(0.1)])) == [0.1]
    assert len(said) == 1 and word in said[0]


def test_messages_of_single_sensors_are_put_together(alignment: Alignment) -> None:
    parts = [Message(0.1 * i, {name: float(i)}) for i in range(4) for name in ("a", "b")]
    samples = [*alignment.add(parts), *alignment.finish()]
    assert times(samples) == [0.0, 0.1, 0.2, 0.3]
    assert np.isnan(samples[0].values[1])
    assert [sample.values.tolist() for sample in samples[1:]] == [[1, 1], [2, 2], [3, 3]]


def test_a_sensor_that_stays_away_is_not_waited_for(alignment: Alignment) -> None:
    started(alignment)
    alone = [Message(0.1 * i, {"a": 1.0}) for i in range(1, 21)]
    waiting = [len(alignment.add([each])) for each in alone]
    assert waiting[0] == 0 and waiting[-1] == 1


def test_a_reading_that_is_nan_is_reported(alignment: Alignment) -> None:
    started(alignment)
    [sample] = alignment.add([message(0.1, b=math.nan)])
    assert sample.values[0] == 1 and np.isnan(sample.values[1])


def test_times_off_the_clock_are_kept(alignment: Alignment, said: list[str]) -> None:
    started(alignment)
    samples = alignment.add([message(0.13), message(0.35)])
    assert times(samples) == [0.13, 0.23, 0.35]
    assert [round(sample.span, 6) for sample in samples] == [0.13, 0.1, 0.12]
    assert any("not on the clock" in line for line in said)


def test_after_a_long_gap_the_filter_begins_again(alignment: Alignment, said: list[str]) -> None:
    started(alignment)
    [sample] = alignment.add([message(1000.0)])
    assert sample.begins and "begins again" in said[0]


def test_an_unknown_column_is_left_out_with_a_remark(alignment: Alignment, said: list[str]) -> None:
    [sample, _] = alignment.add([Message(t, {"a": 1.0, "b": 2.0, "c": 3.0}) for t in (0.0, 0.1)])
    assert sample.values.tolist() == [1.0, 2.0]
    assert len(said) == 1 and "'c'" in said[0]


def test_a_stream_without_any_sensor_is_refused(alignment: Alignment) -> None:
    with pytest.raises(InputError, match="none of the sensors"):
        alignment.add([Message(0.0, {"aa": 1.0, "volts": 2.0})])


def test_single_messages_without_any_sensor_are_refused_after_some(alignment: Alignment) -> None:
    few = [Message(0.1 * i, {"c": 1.0}) for i in range(FOREIGN - 1)]
    assert not alignment.add(few)
    with pytest.raises(InputError, match="none of the sensors"):
        alignment.add([Message(5.0, {"c": 1.0})])
