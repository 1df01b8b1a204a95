"""The rows of the table of estimators."""

from __future__ import annotations

from typing import TypedDict


class Errors(TypedDict):
    """Errors of an estimator, RMSE of the whole field in std of each true field.

    Attributes:
        whole: over the fit window.
        settled: over its second half.
    """

    whole: float
    settled: float


class Row(TypedDict):
    """The result of a case.

    Attributes:
        system: name of the bundled system.
        twin: name of the hidden truth.
        seed: of the recording and of the analysis.
        noise: of the sensors, in std.
        budget: seconds on the clock that the analysis might take; null for the default.
        verdict: of the findings; null without findings.
        exact: whether the law has exactly the true terms; null if no law was sought.
        problem: why there are no findings.
        filter: errors of the ensemble filter on the true law; null if it is lost.
        filter_settings: its members, radius and inflation.
        shred: errors of the corrected SHRED; null without findings.
        observer: errors of the observer; null without one.
        covered: share of the values within the 90 % bands of the observer.
        milliseconds: time of one step of the observer.
    """

    system: str
    twin: str
    seed: int
    noise: float
    budget: int | None
    verdict: str | None
    exact: bool | None
    problem: str | None
    filter: Errors | None
    filter_settings: str
    shred: Errors | None
    observer: Errors | None
    covered: float | None
    milliseconds: float | None


def ratio(row: Row, name: str, part: str) -> float | None:
    """Return the error of an estimator over that of the filter; None without either.

    Args:
        row: of the table.
        name: ``shred`` or ``observer``.
        part: ``whole`` or ``settled``.
    """
    found, best = row["shred"] if name == "shred" else row["observer"], row["filter"]
    if found is None or best is None:
        return None
    return found["whole"] / best["whole"] if part == "whole" else found["settled"] / best["settled"]
