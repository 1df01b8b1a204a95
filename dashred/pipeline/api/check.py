"""What a check of a problem has found, as an object that prints."""

from __future__ import annotations

from dataclasses import dataclass
from html import escape

from dashred.pipeline.check.page import Page


@dataclass(frozen=True, repr=False)
class Check:
    """What is wrong or doubtful about a problem; printing it shows all of it.

    Attributes:
        text: every remark, by section.
        errors: count of remarks on what a run would refuse.
        left_to_do: count of lines that are still to be filled in.
        warnings: count of remarks to look at before a run is trusted.
    """

    text: str
    errors: int
    left_to_do: int
    warnings: int

    @classmethod
    def of(cls, page: Page) -> Check:
        """Take it from what a check has shown."""
        count = page.count
        return cls("\n".join(page.lines), count["error"], count["to do"], count["warning"])

    def __str__(self) -> str:
        """Every remark, by section."""
        return self.text

    __repr__ = __str__

    def _repr_html_(self) -> str:
        return f"<pre>{escape(self.text)}</pre>"
