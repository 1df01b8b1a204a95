"""The cases of a request, and the check of its names."""

from __future__ import annotations

from collections import Counter
from collections.abc import Sequence

from dashred.core.command_line.arguments import COMMAND_LINE
from dashred.core.errors import InputError, nearest
from dashred.core.progress import CONSOLE
from dashred.evaluation.foreign.arguments import Request
from dashred.evaluation.foreign.cases.case import COLLECTIONS, KINDS, Case
from dashred.evaluation.foreign.cases.dysts_systems import polynomial_systems
from dashred.evaluation.foreign.optional import check_installed
from dashred.evaluation.foreign.protocol import draw_cases
from dashred.evaluation.foreign.rows import is_done


def plan(request: Request) -> list[Case]:
    """Return all cases of the draw.

    Raises:
        InputError: a package is missing, or there is no case of a given name.
    """
    check_installed("dysts", "pde")
    cases = draw_cases(request.draw, list(polynomial_systems()), request.noise, request.draws)
    names = [case.name for case in cases]
    for name in request.cases or ():
        if name not in names:
            hint = nearest(name, names) if len(names) < 50 else _close(name, names)
            raise InputError(f"the draw has no case {name}", where=COMMAND_LINE, hint=hint)
    return cases


def _close(name: str, names: Sequence[str]) -> str:
    hint = nearest(name, names)
    return hint if hint.startswith("did") else "`dashred evaluate foreign plan` lists the cases"


def chosen(request: Request, cases: Sequence[Case]) -> list[Case]:
    """Return the cases that a request runs now."""
    return [
        case
        for case in cases
        if case.collection in request.collections
        and (request.cases is None or case.name in request.cases)
    ]


def print_plan(request: Request, cases: Sequence[Case]) -> None:
    """Print the cases that the request would run, and how many of each collection are done."""
    done = {case.name for case in cases if is_done(request.output, case)}
    for case in chosen(request, cases):
        mark = "done" if case.name in done else ""
        CONSOLE.print(
            f"{case.name:<48} {KINDS[case.kind]:<24} {mark}".rstrip(), markup=False, soft_wrap=True
        )
    for collection, title in COLLECTIONS.items():
        names = [case.name for case in cases if case.collection == collection]
        kinds = Counter(KINDS[case.kind] for case in cases if case.collection == collection)
        shares = ", ".join(f"{count} {kind}" for kind, count in kinds.items())
        finished = sum(name in done for name in names)
        CONSOLE.print(
            f"{title}: {finished} of {len(names)} done ({shares})", markup=False, soft_wrap=True
        )
