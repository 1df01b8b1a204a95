"""The rows of a request: what each of them measures."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace

from dashred.evaluation.performance.arguments import Request
from dashred.evaluation.performance.measured.setting import INTERVALS, PIECES, Setting


@dataclass(frozen=True)
class Growth:
    """One quantity that grows, with all others as in the default setting.

    Attributes:
        title: of the quantity, with its unit.
        setting: of a size.
        amount: the number against which seconds and memory are fitted, of a size.
        pieces: what is timed.
    """

    title: str
    setting: Callable[[int], Setting]
    amount: Callable[[int], int] = lambda size: size
    pieces: tuple[str, ...] = PIECES


BASE = Setting()
GROWTHS = {
    "grid": Growth(
        "grid points", lambda n: replace(BASE, points=n), amount=lambda points: points**2
    ),
    "sensors": Growth("sensors", lambda n: replace(BASE, sensors=n)),
    "library": Growth("terms of the library", lambda n: replace(BASE, terms=n)),
    "record": Growth(
        "samples",
        lambda n: replace(BASE, samples=1 + n * INTERVALS),
        amount=lambda length: 1 + length * INTERVALS,
    ),
    "episodes": Growth("episodes", lambda n: replace(BASE, episodes=n)),
    "members": Growth(
        "members of an ensemble", lambda n: replace(BASE, trajectories=n), pieces=("march",)
    ),
}


@dataclass(frozen=True)
class Task:
    """One row.

    Attributes:
        part: of the request.
        size: the number that grows, the number of workers, or the name of a system.
        repeats: how often each piece is timed.
    """

    part: str
    size: int | str
    repeats: int

    @property
    def name(self) -> str:
        """Name of its file."""
        return f"{self.part}-{self.size}"


def tasks_of(request: Request) -> list[Task]:
    """Return the rows of a request in the order in which they are measured."""
    sizes: dict[str, tuple[int | str, ...]] = {
        "grid": request.grid,
        "sensors": request.sensors,
        "library": request.library,
        "record": request.record,
        "episodes": request.episodes,
        "members": request.members,
        "jobs": request.workers,
        "cluster": request.workers,
        "columns": request.workers,
        "stages": request.systems,
    }
    return [Task(part, size, request.repeats) for part in request.parts for size in sizes[part]]
