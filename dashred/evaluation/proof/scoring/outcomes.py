"""Outcomes of one case, computed from its record; None if they do not apply.

A decidable case without the sought value counts as a miss, because the value could be found.
"""

from __future__ import annotations

from dashred.evaluation.proof.cases.case_record import CaseRecord, Coefficient, Gain, Kind
from dashred.evaluation.proof.scoring.statistics import percent

TRUE_CAUSE: dict[Kind, str] = {
    "null": "nothing-missing",
    "start": "initial-condition",
    "numerics": "unresolved-numerics",
    "fault": "sensor-fault",
    "parameter": "parameter",
    "terms": "missing-term",
    "hidden": "missing-term",
    "box": "missing-term",
    "gate": "missing-term",
    "onset": "missing-term",
    "outside": "outside-library",
}
"""The expected leading cause; masked cases have several and are not listed."""

SEARCH_FAILED = 6.0  # larger score differences to the true form are search failures
BEYOND = 20.0  # larger differences to the best law of the library exclude imitation
WORSE = 0.02  # increase of the error on noisy test data that may be chance
WITHOUT_LAW: tuple[Kind, ...] = ("null", "start", "fault", "numerics")


def wrong_unflagged(record: CaseRecord) -> bool | None:
    """Return whether the verdict is wrong and not flagged as uncertain; None for a failed case."""
    if record["problem"] is not None:
        return None
    return not record["right"] and not record["flagged"]


def verdict_is(verdict: str, record: CaseRecord) -> bool | None:
    """Return whether the verdict equals `verdict`; None without a verdict."""
    return None if record["verdict"] is None else record["verdict"] == verdict


def false_alarm(record: CaseRecord) -> bool | None:
    """Return whether a null was reported to hide, or possibly hide, an effect that it does not.

    `ambiguous` is a false alarm; naming a sensor that is misplaced is not.
    """
    return None if record["verdict"] is None else not record["right"]


def false_outside(record: CaseRecord) -> bool | None:
    """Return whether a case inside the library was reported as outside of it."""
    return None if record["kind"] == "outside" else verdict_is("outside-library", record)


def outside_reported(record: CaseRecord) -> bool | None:
    """Return whether a law outside the library was reported; None if the library can imitate it."""
    margin = record["oracle"] and record["oracle"]["over_library"]
    if record["kind"] != "outside" or margin is None or margin <= BEYOND:
        return None
    return record["right"]


def decidable(record: CaseRecord) -> bool | None:
    """Return whether the recording can separate the true form from all others."""
    return None if record["oracle"] is None else record["oracle"]["decidable"]


def decided(record: CaseRecord) -> bool | None:
    """Return whether a decidable case has the right verdict and, if a law was found, its form."""
    if not decidable(record):
        return None
    # A law outside the library is right without its form.
    return record["right"] and (record["kind"] == "outside" or record["exact"] is not False)


def search_failed(record: CaseRecord) -> bool | None:
    """Return whether the search returned a law while the true form scores clearly better.

    None for laws outside the library, which a search cannot find, and for fits that have not
    converged, which are counted separately.
    """
    excluded = record["kind"] == "outside" or record["verdict"] in (None, "not-converged")
    if record["oracle"] is None or excluded:
        return None
    return record["oracle"]["lost"] > SEARCH_FAILED


def leading_right(record: CaseRecord) -> bool | None:
    """Return whether the leading cause has the true kind, also for ambiguous verdicts."""
    if record["right"] or not record["causes"]:
        return True if record["right"] else None
    if record["kind"] == "masked":
        return None if record["verdict"] in ("ambiguous", "unconfirmed") else False
    return record["causes"][0] == TRUE_CAUSE[record["kind"]]


def could_be_found(record: CaseRecord, kind: Kind) -> bool:
    """Return whether a case has this kind of hidden effect and is not undecidable."""
    return record["kind"] == kind and decidable(record) is not False


def overlap(record: CaseRecord) -> float | None:
    """Return the intersection over union of a region; 0 if it was missed."""
    share = record["region"] and record["region"]["overlap"]
    if share is None:
        return 0.0 if could_be_found(record, "box") else None
    return share


def place_inside(record: CaseRecord) -> bool | None:
    """Return whether the told place lies inside the hidden region; False if it was missed.

    The place is the peak of the map of the free forcing, or, where a law in a region was found and
    no map was made, the centre of that region.
    """
    if record["peak_inside"] is not None:
        return record["peak_inside"]
    share = overlap(record)
    # An interval whose intersection over union with another exceeds 1/2 has its centre in it.
    return None if share is None else share > 0.5


def equation_right(record: CaseRecord) -> bool | None:
    """Return whether the equation of the hidden field was named; False if it was missed."""
    if record["equation_right"] is None:
        return False if could_be_found(record, "hidden") else None
    return record["equation_right"]


def onset_near(record: CaseRecord) -> bool | None:
    """Return whether the onset error is within 5 % of the record; False if it was missed."""
    off = record["region"] and record["region"]["onset"]
    if off is None:
        return False if could_be_found(record, "onset") else None
    return off <= 0.05


def threshold_near(record: CaseRecord) -> bool | None:
    """Return whether the threshold error is within 10 % of the range of the state, or 2 std.

    False if it was missed.
    """
    region = record["region"]
    if region is None or region["threshold"] is None:
        return False if could_be_found(record, "gate") else None
    z = region["threshold_z"]
    return region["threshold"] <= 0.1 or (z is not None and abs(z) <= 2)


def gain(record: CaseRecord, at: Gain) -> float | None:
    """Return the factor of error reduction: 1 if no law was found, 0 if the law blows up."""
    if record["kind"] in WITHOUT_LAW:
        return None
    if record["gains"] is None:
        return 1.0
    return record["gains"][at] or 0.0


def coefficient_near(coefficient: Coefficient) -> bool:
    """Return whether the error of a coefficient is within 5 % or 3 std, whichever is larger."""
    allowed = max(0.05 * abs(coefficient["true"]), 3 * (coefficient["std"] or 0.0))
    return abs(coefficient["found"] - coefficient["true"]) <= allowed


def deviation(coefficient: Coefficient) -> float | None:
    """Return the signed error of a coefficient in stated standard deviations."""
    if not coefficient["std"]:
        return None
    return (coefficient["found"] - coefficient["true"]) / coefficient["std"]


def shortcomings(record: CaseRecord) -> list[str]:
    """Return the shortcomings of a case as text; empty if there are none."""
    if record["problem"] is not None:
        return [f"failed: {record['problem']}"]
    lacks = [] if record["right"] else [_describe_wrong(record)]
    # No law of the library has the exact form of a law outside of it.
    if record["right"] and record["exact"] is False and record["kind"] != "outside":
        lacks.append("not the exact form")
    if record["group"] == "nulls" and false_alarm(record):
        lacks.append("false alarm")
    if record["oracle"] is not None and search_failed(record):
        lacks.append(
            f"search failure: the true form scores better by {record['oracle']['lost']:.3g}"
        )
    if record["noisy_test"] is not None and record["noisy_test"] > WORSE:
        lacks.append(f"error on noisy test data larger by {percent(record['noisy_test'])} %")
    checks = {
        "wrong equation of the hidden field": equation_right(record),
        "the told place is outside the region": place_inside(record),
        "the onset is wrong": onset_near(record),
        "the threshold is wrong": threshold_near(record),
    }
    lacks += [text for text, met in checks.items() if met is False]
    wrong = [c["name"] for c in record["coefficients"] if not coefficient_near(c)]
    return [*lacks, *(f"the coefficient of {name} is wrong" for name in wrong)]


def _describe_wrong(record: CaseRecord) -> str:
    if record["listed"]:
        return "flagged, truth listed"
    return "wrong, flagged" if record["flagged"] else "wrong and unflagged"
