"""Progress of a stage on the terminal: a bar while it runs, one line when it has finished."""

from __future__ import annotations

import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager

from rich.console import Console
from rich.progress import BarColumn, Progress, TextColumn, TimeElapsedColumn

CONSOLE = Console(highlight=False)

Report = Callable[[float, str], None]


@contextmanager
def stage(title: str, seconds: dict[str, float] | None = None) -> Iterator[Report]:
    """Show the progress of a stage; yield the callback ``report(fraction, note)``.

    Args:
        title: of the stage, for example ``train SHRED``.
        seconds: gets the duration of the stage under its title.
    """
    began = time.perf_counter()
    columns = (
        TextColumn("{task.description:<28}"),
        BarColumn(bar_width=28),
        TextColumn("{task.fields[note]}"),
        TimeElapsedColumn(),
    )
    last = ""
    with Progress(
        *columns, console=CONSOLE, transient=True, disable=not CONSOLE.is_terminal
    ) as progress:
        task = progress.add_task(title, total=1.0, note="")

        def report(fraction: float, note: str = "") -> None:
            nonlocal last
            last = note or last
            progress.update(task, completed=fraction, note=last)

        yield report
    took = time.perf_counter() - began
    if seconds is not None:
        seconds[title] = took
    CONSOLE.print(f"  {title:<28} {took:6.1f} s  {last}", markup=False, soft_wrap=True)
