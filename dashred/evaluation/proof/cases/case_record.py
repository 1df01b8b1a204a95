"""The schema of `case.json`, which a finished case leaves.

What was not looked for, or has no meaning for a case, is null.
"""

from __future__ import annotations

from typing import Literal, TypedDict

Kind = Literal[
    "null",
    "start",
    "numerics",
    "fault",
    "parameter",
    "terms",
    "hidden",
    "box",
    "gate",
    "onset",
    "outside",
    "masked",
]

KINDS: dict[Kind, str] = {
    "null": "nothing hidden",
    "start": "a start outside of its prior",
    "numerics": "unresolved numerics",
    "fault": "a faulty sensor",
    "parameter": "a wrong parameter",
    "terms": "missing terms",
    "hidden": "terms of the hidden field",
    "box": "a term in a region",
    "gate": "a term gated by the state",
    "onset": "a term from an onset on",
    "outside": "outside of the library",
    "masked": "masked",
}
"""What was hidden, as a reader knows it, in the order of all tables and figures."""


class Region(TypedDict):
    """How well the window was found; null where the truth has none of that sort or none was found.

    Attributes:
        overlap: intersection over union of a box.
        onset: how far off, as a share of the record.
        threshold: how far off, as a share of the state's range.
        threshold_z: the same in its own standard deviations.
    """

    overlap: float | None
    onset: float | None
    threshold: float | None
    threshold_z: float | None


class Coefficient(TypedDict):
    """One coefficient of a law whose form is exact.

    Attributes:
        name: of the term: ``u: u**2``.
        true: what was hidden.
        found: what was told.
        std: as told.
        covered: whether the 95 % interval that was told holds the true one.
        window: what bounds the term; null for one that acts everywhere.
    """

    name: str
    true: float
    found: float
    std: float | None
    covered: bool
    window: Literal["box", "gate", "onset"] | None


class Oracle(TypedDict):
    """The true form, fitted from the true start, in the score by which all laws are compared.

    Attributes:
        over_null: by how much it beats the simulator as it is.
        over_rival: by how much it beats the best other law listed.
        decidable: whether it beats both by more than 6.
        lost: by how much the law that was returned is worse; negative if that one is better. Where
            none was returned, the simulator as it is stands for it.
        over_library: by how much it beats the best law of the library.
    """

    over_null: float
    over_rival: float | None
    decidable: bool
    lost: float
    over_library: float | None


class Gains(TypedDict):
    """Errors against the truth without noise, over that of `corrected`; null if that one blows up.

    Attributes:
        test_sensors: error of `before_refit`, the simulation with its own best start.
        forecast: the same beyond the record.
        test_sensors_before: error of `before`, the simulation from the corrected one's start.
        forecast_before: the same beyond the record.
    """

    test_sensors: float | None
    forecast: float | None
    test_sensors_before: float | None
    forecast_before: float | None


Gain = Literal["test_sensors", "forecast", "test_sensors_before", "forecast_before"]


class CaseRecord(TypedDict):
    """One case: what was hidden, what was told, and how right that is.

    Attributes:
        number: within its group.
        system: name of the config.
        group: the scored cases, or the nulls, which are counted apart.
        kind: class of what was hidden.
        noise: as a fraction of each field's standard deviation.
        sensors: how many.
        hidden: what was hidden, in words.
        told: what the tool said, in words.
        mismatch: rms effect of what was hidden on the sensors, in standard deviations of the noise.
        verdict: as in the findings.
        probability: of the leading cause.
        causes: kinds listed in the findings, the leading one first.
        right: whether the verdict, and what it names, is right.
        listed: right, or flagged ambiguous with the truth among at most three listed.
        exact: whether the form of the law is exact; null where no law was looked for.
        flagged: whether the findings themselves call the verdict uncertain.
        problem: what a case without findings died of.
        equation_right: whether the right equation of a hidden field, or its class, was named.
        region: how well the window was found.
        peak_inside: whether the map's peak lies inside of the hidden region.
        coefficients: of laws whose form is exact.
        oracle: the true form's score against the others.
        gains: of the corrected simulation; only of cases with a law, where one was found.
        noisy_test: `after` over `before_refit` less 1, on the noisy data of the test sensors.
        seconds: of the analysis.
    """

    number: int
    system: str
    group: Literal["cases", "nulls"]
    kind: Kind
    noise: float
    sensors: int
    hidden: str
    told: str
    mismatch: float | None
    verdict: str | None
    probability: float | None
    causes: list[str]
    right: bool
    listed: bool
    exact: bool | None
    flagged: bool
    problem: str | None
    equation_right: bool | None
    region: Region | None
    peak_inside: bool | None
    coefficients: list[Coefficient]
    oracle: Oracle | None
    gains: Gains | None
    noisy_test: float | None
    seconds: float | None


def name_of(record: CaseRecord) -> str:
    """Return what a reader calls it: ``case 17``, ``null 3``."""
    return f"{record['group'].removesuffix('s')} {record['number']}"
