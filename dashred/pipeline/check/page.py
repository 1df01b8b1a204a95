"""What a check prints."""

from __future__ import annotations

import textwrap
from collections.abc import Iterable

from dashred.pipeline.check.remark import Remark

MARKS = {"fine": " ", "doubtful": "?", "to do": "!", "wrong": "x"}
WIDTH = 98


class Page:
    """Prints remarks as they are found, and counts them."""

    def __init__(self) -> None:
        """Begin with nothing."""
        self.count = dict.fromkeys(MARKS, 0)

    def section(self, title: str, remarks: Iterable[Remark]) -> None:
        """Print a section, each remark as soon as it is there; nothing if there is none."""
        begun = False
        for remark in remarks:
            if not begun:
                print(f"\n{title}")
            begun = True
            self.count[remark.kind] += 1
            _print(f"  {MARKS[remark.kind]} ", remark.says)
            if remark.hint:
                _print("      ", remark.hint)

    def conclude(self) -> None:
        """Print what is to be done now."""
        words = {"wrong": "wrong", "to do": "left to do", "doubtful": "doubtful"}
        parts = [f"{self.count[k]} {w} ({MARKS[k]})" for k, w in words.items() if self.count[k]]
        print(f"\n{', '.join(parts) or 'Nothing is doubtful'}.")

    @property
    def wrong(self) -> bool:
        """Whether a run would refuse something."""
        return bool(self.count["wrong"])


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
