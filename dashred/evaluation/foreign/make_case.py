"""Make a case of any collection."""

from __future__ import annotations

from collections.abc import Callable

from dashred.evaluation.foreign.cases.case import Case, Collection, MadeCase
from dashred.evaluation.foreign.cases.dysts_cases import make_dysts_case
from dashred.evaluation.foreign.cases.field_cases import make_field_case
from dashred.evaluation.foreign.cases.mechanics_cases import make_mechanics_case
from dashred.evaluation.foreign.cases.published_cases import make_published_case

_MAKERS: dict[Collection, Callable[[Case], MadeCase]] = {
    "dysts": make_dysts_case,
    "fields": make_field_case,
    "mechanics": make_mechanics_case,
    "published": make_published_case,
}


def make_case(case: Case) -> MadeCase:
    """Make the recording and the truth of a case; the same case gives the same numbers.

    Raises:
        ArithmeticError: the truth cannot be computed.
        InputError: a package of the extra ``evaluation`` is missing.
    """
    return _MAKERS[case.collection](case)
