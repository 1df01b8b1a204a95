"""What can be read off one case's record: how it ended. What does not apply to a case is null.

What a decidable case lacks it has missed: its window was there to be found.
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
"""The cause that findings should put first; of a masked case's several ones none is the first."""

SEARCH_FAILED = 6.0  # a true form that scores better by more was there to be found
BEYOND = 20.0  # a true form that beats all laws of the library by more is not imitated by them
WORSE = 0.02  # on noisy test data: as much may be chance
WITHOUT_LAW: tuple[Kind, ...] = ("null", "start", "fault", "numerics")


def wrong_unflagged(record: CaseRecord) -> bool | None:
    """Return whether a wrong verdict was told as if it were certain; null of a case that died."""
    if record["problem"] is not None:
        return None
    return not record["right"] and not record["flagged"]


def told_as(verdict: str, record: CaseRecord) -> bool | None:
    """Return whether the verdict was this one; null without a verdict."""
    return None if record["verdict"] is None else record["verdict"] == verdict


def false_alarm(record: CaseRecord) -> bool | None:
    """Return whether a null was said to hide something that it does not, or that it might.

    `ambiguous` is one, too; that the sensor which stands off its place does so is none.
    """
    return None if record["verdict"] is None else not record["right"]


def false_outside(record: CaseRecord) -> bool | None:
    """Return whether a law of the library was told to lie outside of it."""
    return None if record["kind"] == "outside" else told_as("outside-library", record)


def outside_told(record: CaseRecord) -> bool | None:
    """Return whether what is outside was told; null where the library imitates it too well."""
    beaten = record["oracle"] and record["oracle"]["over_library"]
    if record["kind"] != "outside" or beaten is None or beaten <= BEYOND:
        return None
    return record["right"]


def decidable(record: CaseRecord) -> bool | None:
    """Return whether the recording can tell the true form from every other."""
    return None if record["oracle"] is None else record["oracle"]["decidable"]


def decided(record: CaseRecord) -> bool | None:
    """Return whether a decidable case has the right verdict and, if a law was found, its form."""
    if not decidable(record):
        return None
    # What lies outside is rightly told without its form.
    return record["right"] and (record["kind"] == "outside" or record["exact"] is not False)


def search_failed(record: CaseRecord) -> bool | None:
    """Return whether the search returned a form while the true one scores clearly better.

    Null of what lies outside of the library, where no search of it could have found that, and of
    what has not converged, which is counted as that.
    """
    unsought = record["kind"] == "outside" or record["verdict"] in (None, "not-converged")
    if record["oracle"] is None or unsought:
        return None
    return record["oracle"]["lost"] > SEARCH_FAILED


def leading_right(record: CaseRecord) -> bool | None:
    """Return whether the leading cause is of the true kind, also where the verdict is open."""
    if record["right"] or not record["causes"]:
        return True if record["right"] else None
    if record["kind"] == "masked":
        return None if record["verdict"] == "ambiguous" else False
    return record["causes"][0] == TRUE_CAUSE[record["kind"]]


def could_be_found(record: CaseRecord, kind: Kind) -> bool:
    """Return whether a case hid something of this kind that could have been found."""
    return record["kind"] == kind and decidable(record) is not False


def overlap(record: CaseRecord) -> float | None:
    """Return intersection over union of a region; 0 of one that was missed."""
    share = record["region"] and record["region"]["overlap"]
    if share is None:
        return 0.0 if could_be_found(record, "box") else None
    return share


def peak_inside(record: CaseRecord) -> bool | None:
    """Return whether the map's peak lies inside of the region; false of one that was missed."""
    if record["peak_inside"] is None:
        return False if could_be_found(record, "box") else None
    return record["peak_inside"]


def equation_right(record: CaseRecord) -> bool | None:
    """Return whether the hidden field's equation was named; false where it was missed."""
    if record["equation_right"] is None:
        return False if could_be_found(record, "hidden") else None
    return record["equation_right"]


def onset_near(record: CaseRecord) -> bool | None:
    """Return whether an onset was found within 5 % of the record; false where it was missed."""
    off = record["region"] and record["region"]["onset"]
    if off is None:
        return False if could_be_found(record, "onset") else None
    return off <= 0.05


def threshold_near(record: CaseRecord) -> bool | None:
    """Return whether a threshold was found within 10 % of the state's range, or within 2 std.

    False where it was missed.
    """
    region = record["region"]
    if region is None or region["threshold"] is None:
        return False if could_be_found(record, "gate") else None
    z = region["threshold_z"]
    return region["threshold"] <= 0.1 or (z is not None and abs(z) <= 2)


def gain(record: CaseRecord, at: Gain) -> float | None:
    """Return by what factor a law shrinks the error: 1 if none was found, 0 if it blows up."""
    if record["kind"] in WITHOUT_LAW:
        return None
    if record["gains"] is None:
        return 1.0
    return record["gains"][at] or 0.0


def coefficient_near(coefficient: Coefficient) -> bool:
    """Return whether a coefficient was found within 5 % or 3 std, whichever is more."""
    allowed = max(0.05 * abs(coefficient["true"]), 3 * (coefficient["std"] or 0.0))
    return abs(coefficient["found"] - coefficient["true"]) <= allowed


def deviation(coefficient: Coefficient) -> float | None:
    """Return how far off a coefficient is, with its sign, in standard deviations as told."""
    if not coefficient["std"]:
        return None
    return (coefficient["found"] - coefficient["true"]) / coefficient["std"]


def failings(record: CaseRecord) -> list[str]:
    """Return all that a case falls short in, in words; nothing if it went well."""
    if record["problem"] is not None:
        return [f"died: {record['problem']}"]
    said = [] if record["right"] else [_how_wrong(record)]
    # Of what no law of the library expresses, none can have the exact form.
    if record["right"] and record["exact"] is False and record["kind"] != "outside":
        said.append("not the exact form")
    if record["group"] == "nulls" and false_alarm(record):
        said.append("false alarm")
    if record["oracle"] is not None and search_failed(record):
        said.append(f"search failure: the true form is better by {record['oracle']['lost']:.3g}")
    if record["noisy_test"] is not None and record["noisy_test"] > WORSE:
        said.append(f"noisy test data worse by {percent(record['noisy_test'])} %")
    looked_for = {
        "not the hidden field's equation": equation_right(record),
        "the map's peak lies elsewhere": peak_inside(record),
        "the onset is off": onset_near(record),
        "the threshold is off": threshold_near(record),
    }
    said += [words for words, met in looked_for.items() if met is False]
    off = [c["name"] for c in record["coefficients"] if not coefficient_near(c)]
    return [*said, *(f"the coefficient of {name} is off" for name in off)]


def _how_wrong(record: CaseRecord) -> str:
    if record["listed"]:
        return "left open, the truth listed"
    return "wrong, flagged" if record["flagged"] else "wrong and unflagged"
