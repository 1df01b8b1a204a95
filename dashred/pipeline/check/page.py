"""Collect the remarks of a check and show them as they arrive."""

from __future__ import annotations

import textwrap
from collections.abc import Callable, Iterable

from dashred.core.formatting import plural
from dashred.pipeline.check.remark import Remark

MARKS = {"ok": " ", "warning": "?", "to do": "!", "error": "x"}
WIDTH = 98


def _print(text: str) -> None:
    print(text, flush=True)


class Page:
    """Collects the remarks of a check by section and shows each as it arrives.

    Attributes:
        lines: the text that was shown.
        count: number of remarks of each kind.
    """

    def __init__(self, show: Callable[[str], None] = _print) -> None:
        """Start with no remarks; ``show`` is called with every line."""
        self.count = dict.fromkeys(MARKS, 0)
        self.lines: list[str] = []
        self._show = show

    def title(self, text: str) -> None:
        """Show the title of the check."""
        self._put(text)

    def section(self, title: str, remarks: Iterable[Remark]) -> None:
        """Show a section, each remark as soon as it arrives; nothing if there is none."""
        has_title = False
        for remark in remarks:
            if not has_title:
                self._put(f"\n{title}")
            has_title = True
            self.count[remark.kind] += 1
            self._put(_wrapped(f"  {MARKS[remark.kind]} ", remark.text))
            if remark.hint:
                self._put(_wrapped("      ", remark.hint))

    def conclude(self) -> None:
        """Show the number of remarks that need attention."""
        labels = {
            "error": plural(self.count["error"], "error"),
            "to do": f"{self.count['to do']} left to do",
            "warning": plural(self.count["warning"], "warning"),
        }
        parts = [f"{text} ({MARKS[kind]})" for kind, text in labels.items() if self.count[kind]]
        self._put(f"\n{', '.join(parts) or 'No errors and no warnings'}.")

    @property
    def has_errors(self) -> bool:
        """Whether a run would refuse the input."""
        return bool(self.count["error"])

    def _put(self, text: str) -> None:
        self.lines.append(text)
        self._show(text)


def _wrapped(begin: str, text: str) -> str:
    rest = " " * len(begin)
    lines = textwrap.wrap(
        text,
        WIDTH,
        initial_indent=begin,
        subsequent_indent=rest,
        break_long_words=False,
        break_on_hyphens=False,
    )
    return "\n".join(lines)
