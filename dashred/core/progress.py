"""Progress of a stage: a bar while it runs, a line when it is done, on whichever display is set."""

from __future__ import annotations

import time
from collections.abc import Callable, Iterator
from contextlib import AbstractContextManager, contextmanager, nullcontext
from contextvars import ContextVar
from typing import Protocol

from rich.console import Console
from rich.progress import BarColumn, Progress, TextColumn, TimeElapsedColumn

CONSOLE = Console(highlight=False)

Report = Callable[[float, str], None]


class Display(Protocol):
    """Where progress is shown."""

    def bar(self, title: str) -> AbstractContextManager[Report]:
        """Show a bar; yields ``report(fraction done, note)``."""

    def line(self, text: str) -> None:
        """Show a line that stays."""


class Terminal:
    """The terminal; without one, lines alone."""

    @contextmanager
    def bar(self, title: str) -> Iterator[Report]:
        """Show a bar that goes away when the stage is done."""
        columns = (
            TextColumn("{task.description:<28}"),
            BarColumn(bar_width=28),
            TextColumn("{task.fields[note]}"),
            TimeElapsedColumn(),
        )
        with Progress(
            *columns, console=CONSOLE, transient=True, disable=not CONSOLE.is_terminal
        ) as progress:
            task = progress.add_task(title, total=1.0, note="")
            yield lambda fraction, note: progress.update(task, completed=fraction, note=note)

    def line(self, text: str) -> None:
        """Print the text as it is: nothing in it is markup."""
        CONSOLE.print(text, markup=False, highlight=False, soft_wrap=True)


class Silent:
    """Shows nothing."""

    def bar(self, title: str) -> AbstractContextManager[Report]:
        """Take the reports and drop them."""
        return nullcontext(lambda fraction, note: None)

    def line(self, text: str) -> None:
        """Drop it."""


TERMINAL = Terminal()
_display: ContextVar[Display] = ContextVar("display", default=TERMINAL)


@contextmanager
def shown_on(display: Display) -> Iterator[None]:
    """Show the progress of all stages that run meanwhile on this display."""
    before = _display.set(display)
    try:
        yield
    finally:
        _display.reset(before)


def say(text: str) -> None:
    """Show a line on the display."""
    _display.get().line(text)


@contextmanager
def stage(title: str, seconds: dict[str, float] | None = None) -> Iterator[Report]:
    """Show the progress of a stage; yield the callback ``report(fraction, note)``.

    Args:
        title: of the stage, for example ``train SHRED``.
        seconds: gets the duration of the stage under its title.
    """
    began = time.perf_counter()
    last = ""
    with _display.get().bar(title) as show:

        def report(fraction: float, note: str = "") -> None:
            nonlocal last
            last = note or last
            show(fraction, last)

        yield report
    took = time.perf_counter() - began
    if seconds is not None:
        seconds[title] = took
    say(f"  {title:<28} {took:6.1f} s  {last}")
