"""Schema of `case.json`, the record of a finished case.

A value that was not sought or does not apply to a case is null.
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
"""Labels of the kinds of hidden effects, in the order of all tables and figures."""


class Region(TypedDict):
    """Errors of the window that was found; null if the truth has no such window or none was found.

    Attributes:
        overlap: intersection over union of a box.
        onset: error as a share of the record.
        threshold: error as a share of the range of the state.
        threshold_z: error of the threshold in its stated standard deviations.
    """

    overlap: float | None
    onset: float | None
    threshold: float | None
    threshold_z: float | None


class Coefficient(TypedDict):
    """One coefficient of a law whose form is exact.

    Attributes:
        name: equation and term: ``u: u**2``.
        true: true value.
        found: estimate.
        std: stated standard deviation.
        covered: whether the stated 95 % interval contains the true value.
        window: kind of window; null for a term that acts everywhere.
    """

    name: str
    true: float
    found: float
    std: float | None
    covered: bool
    window: Literal["box", "gate", "onset"] | None


class Oracle(TypedDict):
    """Score differences of the true form, fitted from the true start, to other laws.

    Attributes:
        over_null: to the unchanged simulator.
        over_rival: to the best other law listed.
        decidable: whether both differences exceed 6.
        lost: to the returned law, or to the unchanged simulator if none was returned; negative if
            the returned law is better.
        over_library: to the best law of the library.
    """

    over_null: float
    over_rival: float | None
    decidable: bool
    lost: float
    over_library: float | None


class Gains(TypedDict):
    """Errors against the noise-free truth, divided by that of `corrected`; null if it blows up.

    Attributes:
        test_sensors: error of `before_refit`, the simulation from its fitted start.
        forecast: the same after the end of the record.
        test_sensors_before: error of `before`, the simulation from the start of the corrected one.
        forecast_before: the same after the end of the record.
    """

    test_sensors: float | None
    forecast: float | None
    test_sensors_before: float | None
    forecast_before: float | None


Gain = Literal["test_sensors", "forecast", "test_sensors_before", "forecast_before"]


class CaseRecord(TypedDict):
    """Record of one case: hidden effect, findings and scores.

    Attributes:
        number: number within the group.
        system: name of the configuration.
        group: scored cases, or nulls, which are counted separately.
        kind: kind of the hidden effect.
        noise: noise as a fraction of the standard deviation of each field.
        sensors: number of fit sensors.
        hidden: description of the hidden effect.
        told: description of the findings.
        mismatch: rms of the hidden effect at the sensors, in standard deviations of the noise.
        verdict: verdict of the findings.
        probability: probability of the leading cause.
        causes: kinds of the causes in the findings, the leading one first.
        right: whether the verdict and the cause that it names are right.
        listed: right, or flagged with the truth among the first three explanations.
        exact: whether the form of the law is exact; null if no law was sought.
        flagged: whether the findings call the verdict uncertain.
        problem: why a case has no findings.
        equation_right: whether the law of a hidden field was found in the right equation.
        region: errors of the window.
        peak_inside: whether the peak of the forcing map lies inside the hidden region.
        coefficients: coefficients of laws whose form is exact.
        oracle: score of the true form against others.
        gains: gains of the corrected simulation, if a law was hidden and one was found.
        noisy_test: `after` over `before_refit`, minus 1, on noisy data of the test sensors.
        seconds: CPU seconds of the analysis.
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
    """Return the name of a case: ``case 17``, ``null 3``."""
    return f"{record['group'].removesuffix('s')} {record['number']}"
