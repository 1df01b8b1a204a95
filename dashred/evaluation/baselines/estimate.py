"""What one method makes of a recording."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TypedDict

from torch import Tensor


class TermEntry(TypedDict):
    """One term of a law, as the findings hold it."""

    equation: str
    term: str
    coefficient: float


@dataclass(frozen=True)
class Estimated:
    """A field, and a law where the method knows one.

    Attributes:
        states: ``(time, field, *grid)`` over the fit window.
        terms: of its law; None where it looks for none.
        note: how it was set, in a few words.
    """

    states: Tensor
    terms: list[TermEntry] | None
    note: str
