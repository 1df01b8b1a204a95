"""The rows of the table: a twin, analysed with its equations and through a program."""

from __future__ import annotations

from typing import TypedDict


class Answer(TypedDict):
    """The result of one analysis.

    Attributes:
        verdict: of the findings; null without findings.
        exact: whether the law has exactly the true terms; null if no law was sought.
        error: largest relative error of its coefficients; null if it is not exact.
        deviation: largest error of a coefficient in units of its stated std; null likewise.
        seconds: CPU seconds of the analysis.
        problem: why there are no findings.
    """

    verdict: str | None
    exact: bool | None
    error: float | None
    deviation: float | None
    seconds: float
    problem: str | None


class Row(TypedDict):
    """The result of a case.

    Attributes:
        system: name of the bundled system.
        twin: name of the hidden truth.
        seed: of the recording and of the analyses.
        budget: seconds on the clock that each analysis might take; null for the default.
        equations: the analysis with equations.
        program: the analysis through a function.
        calls: number of calls of the function.
        states: number of states that they stepped.
        seconds_inside: wall-clock seconds inside of the function.
    """

    system: str
    twin: str
    seed: int
    budget: int | None
    equations: Answer
    program: Answer
    calls: int
    states: int
    seconds_inside: float
