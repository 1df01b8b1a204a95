"""The estimate of a method."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TypedDict

from torch import Tensor


class TermEntry(TypedDict):
    """One term of a law, as in findings."""

    equation: str
    term: str
    coefficient: float


class ParameterEntry(TypedDict):
    """One parameter with its new value, as in findings."""

    equation: None
    parameter: str
    to: float


@dataclass(frozen=True)
class Estimate:
    """A field and, if the method seeks one, a law.

    Attributes:
        states: ``(time, field, *grid)`` over the fit window.
        terms: terms of the law; None if the method does not seek one.
        note: short description of the settings.
    """

    states: Tensor
    terms: list[TermEntry] | None
    note: str
