"""What the stages of an analysis log to: a run of MLflow, or nothing at all."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator, Mapping
from contextlib import AbstractContextManager, contextmanager
from typing import Any, Protocol

# Logs one point of each curve: ``log(metrics, step)``.
Log = Callable[[Mapping[str, float], int], None]


class StageTracker(Protocol):
    """The log of one stage."""

    def log_metrics(self, metrics: Mapping[str, float], step: int) -> None:
        """Log one point of each curve."""

    def set_tags(self, tags: Mapping[str, Any]) -> None:
        """Set tags."""

    def log_terms(self, terms: Iterable[str]) -> None:
        """Log the names of the terms that metrics are named after."""


class RunTracker(StageTracker, Protocol):
    """The log of a whole run, with one of its own for each stage."""

    def child(self, name: str) -> AbstractContextManager[StageTracker]:
        """Open the log of a stage."""


class NullTracker:
    """A log that keeps nothing."""

    def log_metrics(self, metrics: Mapping[str, float], step: int) -> None:
        """Drop them."""

    def set_tags(self, tags: Mapping[str, Any]) -> None:
        """Drop them."""

    def log_terms(self, terms: Iterable[str]) -> None:
        """Drop them."""

    @contextmanager
    def child(self, name: str) -> Iterator[StageTracker]:
        """Yield this log, which keeps nothing of a stage either."""
        yield self
