"""The schema of a hidden state in the findings."""

from typing import NotRequired, TypedDict


class HiddenStateFound(TypedDict):
    """A state z that is not in the equations: ``z' = (u - z)/τ``, and f' gains ``gain·term``.

    `state` is the name of z and `follows` that of u, a field or an input. `equation` is f, and
    `term` is z or ``z - u``. `constant` is the name of τ in the corrected equations. `ci95` are
    95 % intervals. `start` is the fitted z at the first sample. The units exist if they follow from
    stated units.
    """

    state: str
    follows: str
    equation: str
    term: str
    constant: str
    time_constant: float
    time_constant_std: float
    time_constant_ci95: list[float]
    gain: float
    gain_std: float
    gain_ci95: list[float]
    start: float
    time_unit: NotRequired[str]
    gain_unit: NotRequired[str]
    says: NotRequired[str]
