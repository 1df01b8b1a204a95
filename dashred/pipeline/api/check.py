"""Result of the check of a problem."""

from __future__ import annotations

from dataclasses import dataclass
from html import escape

from dashred.pipeline.check.page import Page


@dataclass(frozen=True, repr=False)
class Check:
    """Errors and warnings about a problem; printing the object shows all of them.

    Attributes:
        text: all remarks, by section.
        errors: number of errors, which a run would refuse.
        left_to_do: number of lines of the configuration that are not filled in yet.
        warnings: number of warnings, which should be examined before a run is trusted.
    """

    text: str
    errors: int
    left_to_do: int
    warnings: int

    @classmethod
    def of(cls, page: Page) -> Check:
        """Return the result that a check has written to its page."""
        count = page.count
        return cls("\n".join(page.lines), count["error"], count["to do"], count["warning"])

    def __str__(self) -> str:
        """All remarks, by section."""
        return self.text

    __repr__ = __str__

    def _repr_html_(self) -> str:
        return f"<pre>{escape(self.text)}</pre>"
