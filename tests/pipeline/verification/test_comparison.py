"""The difference of the errors on held-out data, with an error bar, and misfits at sensors."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from dashred.core.findings.fit_schema import Comparison
from dashred.pipeline.verification.comparison import compare_held_out, misfits_at_sensors
from dashred.pipeline.verification.held_out import held_out_samples
from dashred.pipeline.verification.predictions import Array, Predictions

TIMES = np.linspace(0.0, 10.0, 80)
TRUTH = np.stack([np.sin(TIMES), np.cos(1.3 * TIMES)], axis=1)
SIGMA = 0.05


def predictions(
    before: Array, after: Array, is_predictable: bool = True, seed: int = 0
) -> Predictions:
    """Return predictions that differ from the truth by the given errors, ``(time,)``."""
    noise = SIGMA * np.random.default_rng(seed).standard_normal(TRUTH.shape)
    read = {"simulation_refit": TRUTH + before[:, None], "corrected": TRUTH + after[:, None]}
    return Predictions(
        TIMES, TRUTH + noise, np.ones(2), read, np.zeros(TRUTH.shape), is_predictable
    )


def compared(part: Predictions) -> Comparison:
    [found] = compare_held_out({"heldout_time": [part]})
    return found


def test_held_out_samples_are_the_times_with_readings() -> None:
    part = predictions(np.zeros(80), np.zeros(80))
    part.recorded[:3] = np.nan
    part.recorded[10, 0] = np.nan
    unread = replace(part, recorded=np.full((80, 0), np.nan))
    counted = held_out_samples({"heldout_time": [part, part], "test_sensors": [unread]})
    assert counted == {"heldout_time": 2 * 77}


def test_the_difference_of_the_squared_errors_is_that_of_the_runs() -> None:
    before, after = np.full(80, 0.2), np.full(80, 0.5)
    found = compared(predictions(before, after))
    assert found["after"] ** 2 - found["before"] ** 2 == pytest.approx(found["difference"])
    assert found["difference"] == pytest.approx(0.5**2 - 0.2**2, abs=0.01)
    assert found["worse"] and found["samples"] == 80 and found["horizon"] is None
    assert not compared(predictions(after, before))["worse"]


@pytest.mark.parametrize("seed", range(20))
def test_equal_runs_are_not_told_apart_by_noise(seed: int) -> None:
    shift = 0.01 * np.ones(80)
    assert not compared(predictions(shift, -shift, seed=seed))["worse"]


def test_an_error_that_grows_with_time_is_worse() -> None:
    growing = 0.05 + (TIMES / 10) ** 2
    assert compared(predictions(0.05 + 0 * TIMES, growing))["worse"]
    assert not compared(predictions(growing, 0.05 + 0 * TIMES))["worse"]


def test_a_run_that_is_better_in_one_half_and_worse_in_the_other_is_not_worse() -> None:
    swing = 0.3 * np.sign(np.sin(3 * TIMES))
    before, after = 0.3 + swing, 0.35 - swing
    assert compared(predictions(before, after))["difference"] > 0
    assert not compared(predictions(before, after))["worse"]


def test_a_run_that_blows_up_is_worse() -> None:
    lost = np.where(TIMES < 4, 0.1, np.nan)
    found = compared(predictions(np.full(80, 0.1), lost))
    assert found["worse"] and found["after"] == np.inf
    assert not compared(predictions(lost, lost))["worse"]
    few = compared(predictions(np.full(80, 0.1), np.full(80, np.nan)).truncate(5))
    assert few["worse"] and few["error"] is None


def test_few_samples_say_nothing() -> None:
    few = predictions(np.zeros(80), np.ones(80)).truncate(5)
    assert compared(few)["error"] is None and not compared(few)["worse"]
    part = predictions(np.zeros(80), np.ones(80)).truncate(0)
    assert compare_held_out({"heldout_time": [part]}) == []


def test_a_chaotic_system_is_compared_until_both_runs_are_lost() -> None:
    # Both errors saturate, the corrected one later. After that it happens to be larger.
    before = np.where(TIMES < 3, TIMES / 2, 1.2)
    after = np.where(TIMES < 5, TIMES / 10, 2.0)
    assert compared(predictions(before, after))["difference"] > 0.5
    found = compared(predictions(before, after, is_predictable=False))
    assert not found["worse"] and found["horizon"] == pytest.approx(5.0, abs=0.2)
    assert found["after"] < 0.5 * found["before"]
    # The law that is lost early, while the simulation is not, is worse.
    assert compared(predictions(0.05 + 0 * TIMES, before, is_predictable=False))["worse"]
    # If both are lost before the held-out time begins, there is nothing to compare.
    late = predictions(before + 2, after + 2, is_predictable=False)
    assert compare_held_out({"heldout_time": [late]}) == []
    # So it is if the first sample alone is left.
    first = predictions(before + 2, np.where(TIMES > 0, 2.0, 0.1), is_predictable=False)
    assert compare_held_out({"heldout_time": [first]}) == []


def test_a_run_that_is_lost_from_the_beginning_is_not_compared() -> None:
    wrong = predictions(np.full(80, 0.2), np.full(80, 1.4), is_predictable=False)
    assert compared(wrong)["worse"]
    assert compare_held_out({"heldout_time": [replace(wrong, is_lost=True)]}) == []


def test_samples_of_several_episodes_are_pooled() -> None:
    parts = [predictions(np.full(80, 0.2), np.full(80, 0.5), seed=seed) for seed in range(6)]
    [found] = compare_held_out({"heldout_time": [part.truncate(8) for part in parts]})
    assert found["samples"] == 48 and found["worse"]
    assert not compared(parts[0].truncate(8))["worse"]
    [found] = compare_held_out({"heldout_time": [part.truncate(4) for part in parts]})
    assert found["samples"] == 24 and found["error"] is None


def test_missing_readings_are_not_compared() -> None:
    part = predictions(np.full(80, 0.2), np.full(80, 0.5))
    part.recorded[::2] = np.nan
    part.recorded[1::4, 0] = np.nan
    found = compared(part)
    assert found["samples"] == 40 and found["worse"]


def test_a_faulty_sensor_is_corrected_for_both_runs() -> None:
    part = predictions(np.full(80, 0.1), np.full(80, 0.1))
    offset = np.array([0.8, 0.0]) * np.ones_like(part.recorded)
    biased = replace(part, recorded=part.recorded + offset, offset=offset)
    assert compared(biased)["difference"] == pytest.approx(0.0, abs=1e-12)
    # In the table of errors, only the corrected simulator knows the fault.
    assert float(np.abs(biased.errors("simulation_refit")[:, 0]).mean()) > 0.5
    assert float(np.abs(biased.errors("corrected")[:, 0]).mean()) < 0.2


@pytest.mark.parametrize(("shift", "expected"), [(0.0, 1.0), (0.4, np.hypot(8, 1))])
def test_the_misfit_at_sensors_is_in_standard_deviations_of_the_noise(
    shift: float, expected: float
) -> None:
    part = predictions(np.zeros(80), np.full(80, shift))
    found = misfits_at_sensors([part, part], {"a": SIGMA, "b": 2 * SIGMA})
    assert found == pytest.approx({"a": expected, "b": expected / 2}, rel=0.1)
    scaled = replace(part, scale=np.full(2, 5.0))
    assert misfits_at_sensors([scaled], {"a": SIGMA, "b": 2 * SIGMA}) == pytest.approx(found)


def test_a_run_that_blows_up_has_an_infinite_misfit_and_missing_samples_do_not_count() -> None:
    part = predictions(np.zeros(80), np.zeros(80))
    noise = {"a": SIGMA, "b": SIGMA}
    gaps = part.recorded.copy()
    gaps[::2, 0] = np.nan
    gaps[:, 1] = np.nan
    missing = misfits_at_sensors([replace(part, recorded=gaps)], noise)
    assert missing == pytest.approx({"a": 1.0}, rel=0.2)
    assert misfits_at_sensors([], noise) == {}
    lost = part.read | {"corrected": np.where(TIMES[:, None] > 5, np.nan, TRUTH)}
    assert misfits_at_sensors([replace(part, read=lost)], noise) == {"a": np.inf, "b": np.inf}
