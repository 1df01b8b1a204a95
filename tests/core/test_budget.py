"""A budget divides its time, and remembers what there was no time for."""

from __future__ import annotations

import time

import pytest

from dashred.core.budget import NEVER, Budget, Deadline, OutOfTimeError, duration, in_time


def test_a_deadline_is_over_when_its_time_has_come() -> None:
    past, future = Deadline(time.monotonic() - 1), Deadline(time.monotonic() + 60)
    assert past.is_over
    assert not future.is_over
    assert not NEVER.is_over
    future.check()
    with pytest.raises(OutOfTimeError):
        past.check()


def test_a_stage_may_have_a_part_of_what_is_left() -> None:
    end = Budget(100.0, began=time.monotonic() - 20).deadline(0.5)
    assert end.part(1 / 3).at == pytest.approx(time.monotonic() + 10.0, abs=1)
    assert NEVER.part(1 / 3) == NEVER
    assert Deadline(time.monotonic() - 1).part(1 / 3).is_over


def test_shares_are_measured_from_the_beginning_of_the_run() -> None:
    budget = Budget(100.0, began=time.monotonic() - 50)
    assert budget.deadline(0.4).is_over
    assert not budget.deadline(0.6).is_over
    assert budget.spent == pytest.approx(50, abs=1)
    assert budget.left == pytest.approx(50, abs=1)


def test_the_time_on_the_clock_and_the_time_of_the_processor_differ() -> None:
    budget = Budget.begin(100.0)
    time.sleep(0.2)
    assert budget.cpu < 0.1 < budget.spent
    end = time.process_time() + 0.1
    while time.process_time() < end:
        pass
    assert budget.cpu >= 0.05
    assert duration(75.0, 12.0) == "75 s (12 s of CPU)"


def test_a_budget_without_a_bound_never_ends() -> None:
    assert not Budget().deadline(0.1).is_over


def test_what_there_is_no_time_for_is_replaced_and_noted_once() -> None:
    budget = Budget()

    def late() -> int:
        raise OutOfTimeError

    assert budget.attempt("sensor faults", late, 7) == 7
    assert budget.attempt("sensor faults", late, 8) == 8
    assert budget.attempt("windows", lambda: 3, 0) == 3
    assert budget.not_tried == ["sensor faults"]


def test_another_error_is_not_taken_for_lack_of_time() -> None:
    def broken() -> int:
        raise ValueError("no")

    with pytest.raises(ValueError, match="no"):
        Budget().attempt("windows", broken, 0)


def test_results_are_kept_up_to_the_item_for_which_there_is_no_time() -> None:
    def square(item: int) -> int:
        if item == 3:
            raise OutOfTimeError
        return item**2

    assert in_time(square, [1, 2, 3, 4]) == [1, 4]
    assert in_time(square, [1, 2, 4]) == [1, 4, 16]
