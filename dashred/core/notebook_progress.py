"""Progress in a notebook: one output that is rewritten as stages begin, go on and end."""

from __future__ import annotations

import sys
import time
from collections.abc import Iterator
from contextlib import contextmanager
from html import escape
from typing import Any

from dashred.core.progress import Display, Report, Silent, Terminal

# Seconds between two updates of a bar: a notebook's page is slower than a terminal.
PERIOD = 0.2


class Notebook:
    """A list of the stages that are done, above the bar of the one that runs."""

    def __init__(self) -> None:
        """Begin with an empty output."""
        from IPython.display import HTML, DisplayHandle

        self._html: Any = HTML
        self._handle: Any = DisplayHandle()
        self._lines: list[str] = []
        self._last = 0.0
        self._handle.display(HTML(""))

    @contextmanager
    def bar(self, title: str) -> Iterator[Report]:
        """Show a bar below the lines."""

        def report(fraction: float, note: str) -> None:
            if time.monotonic() - self._last > PERIOD:
                done = f'<progress max="1" value="{fraction:.3f}"></progress>'
                self._show(f"<div>{escape(title)} {done} {escape(note)}</div>")

        report(0.0, "")
        yield report

    def line(self, text: str) -> None:
        """Add a line."""
        self._lines.append(text)
        self._show("")

    def _show(self, below: str) -> None:
        self._last = time.monotonic()
        lines = escape("\n".join(self._lines))
        self._handle.update(self._html(f"<pre>{lines}</pre>{below}"))


def display_here(progress: bool) -> Display:
    """Return the display of the place of this process: a notebook, a terminal, or none."""
    if not progress:
        return Silent()
    return Notebook() if in_notebook() else Terminal()


def in_notebook() -> bool:
    """Whether a Jupyter kernel runs this code."""
    if "IPython" not in sys.modules:
        return False
    from IPython import get_ipython

    return type(get_ipython()).__name__ == "ZMQInteractiveShell"
