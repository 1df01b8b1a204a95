"""Print the remarks of a check."""

from __future__ import annotations

import textwrap
from collections.abc import Iterable

from dashred.pipeline.check.remark import Remark, plural

MARKS = {"ok": " ", "warning": "?", "to do": "!", "error": "x"}
WIDTH = 98


class Page:
    """Print remarks as they arrive and count them by kind."""

    def __init__(self) -> None:
        """Start with no remarks."""
        self.count = dict.fromkeys(MARKS, 0)

    def section(self, title: str, remarks: Iterable[Remark]) -> None:
        """Print a section, each remark as soon as it arrives; nothing if there is none."""
        has_title = False
        for remark in remarks:
            if not has_title:
                print(f"\n{title}")
            has_title = True
            self.count[remark.kind] += 1
            _print(f"  {MARKS[remark.kind]} ", remark.text)
            if remark.hint:
                _print("      ", remark.hint)

    def conclude(self) -> None:
        """Print the number of remarks that need attention."""
        labels = {
            "error": plural(self.count["error"], "error"),
            "to do": f"{self.count['to do']} left to do",
            "warning": plural(self.count["warning"], "warning"),
        }
        parts = [f"{text} ({MARKS[kind]})" for kind, text in labels.items() if self.count[kind]]
        print(f"\n{', '.join(parts) or 'No errors and no warnings'}.")

    @property
    def has_errors(self) -> bool:
        """Whether a run would refuse the input."""
        return bool(self.count["error"])


def _print(begin: str, text: str) -> None:
    rest = " " * len(begin)
    lines = textwrap.wrap(
        text,
        WIDTH,
        initial_indent=begin,
        subsequent_indent=rest,
        break_long_words=False,
        break_on_hyphens=False,
    )
    print("\n".join(lines), flush=True)
