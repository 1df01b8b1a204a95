"""Training ends at its deadline, after at least one epoch."""

from __future__ import annotations

import time
from types import SimpleNamespace
from typing import Any

from callbacks import TimeLimit
from dashred.core.budget import NEVER, Deadline


def trainer(epoch: int, others: bool = False) -> Any:
    """Return a trainer in an epoch; ``others``: whether the time is up in another process."""
    strategy = SimpleNamespace(reduce_boolean_decision=lambda is_over, all: is_over or others)
    return SimpleNamespace(current_epoch=epoch, max_epochs=5, should_stop=False, strategy=strategy)


def test_training_ends_after_the_epoch_in_which_the_time_is_up() -> None:
    limit, running = TimeLimit(Deadline(time.monotonic() - 1)), trainer(0)
    limit.on_train_epoch_end(running, None)  # type: ignore[arg-type]
    assert running.should_stop
    assert limit.ended_at == 1


def test_training_goes_on_before_the_deadline() -> None:
    limit, running = TimeLimit(NEVER), trainer(0)
    limit.on_train_epoch_end(running, None)  # type: ignore[arg-type]
    assert not running.should_stop
    assert limit.ended_at is None


def test_the_last_epoch_is_not_ended_early() -> None:
    limit, running = TimeLimit(Deadline(time.monotonic() - 1)), trainer(4)
    limit.on_train_epoch_end(running, None)  # type: ignore[arg-type]
    assert limit.ended_at is None


def test_all_processes_end_where_the_time_is_up_in_one() -> None:
    limit, running = TimeLimit(NEVER), trainer(1, others=True)
    limit.on_train_epoch_end(running, None)  # type: ignore[arg-type]
    assert running.should_stop
    assert limit.ended_at == 2
