"""Held-out data reject a law that is worse, and faults of sensors if the simulator errs, too."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from dashred.core.findings.cause_schema import Cause, Verdict
from dashred.core.findings.fit_schema import Comparison, FaultContradiction
from dashred.pipeline.verification.confirmation import contradiction_of_faults, is_law_contradicted
from tests import laws


def compared(after: float, before: float = 0.3) -> Comparison:
    """Return a comparison of long runs with these errors."""
    difference = after**2 - before**2
    return Comparison(
        data="heldout_time",
        before=before,
        after=after,
        difference=difference,
        error=0.01,
        samples=80,
        horizon=None,
        worse=difference > 0.01,
    )


WORSE, BETTER = compared(0.5), compared(0.1)


@pytest.mark.parametrize(
    ("kind", "comparisons", "expected"),
    [
        ("missing-term", [BETTER, WORSE], True),
        ("ambiguous", [WORSE], True),
        ("missing-term", [BETTER], False),
        ("missing-term", [], False),
        ("nothing-missing", [WORSE], False),
        ("not-converged", [WORSE], False),
    ],
)
def test_only_a_verdict_with_a_law_is_contradicted_by_a_larger_error(
    tmp_path: Path, kind: Verdict, comparisons: list[Comparison], expected: bool
) -> None:
    law = laws.law([laws.term(laws.declared(tmp_path), "u", "u")], [0.1])
    told: Cause = {"kind": kind, "probability": 1.0, "where": None, "terms": ["u: u"]}
    assert is_law_contradicted(kind, [told], law, comparisons) == expected
    assert not is_law_contradicted(kind, [told], laws.law(), comparisons)


def test_an_effect_outside_of_the_library_stays_so_if_the_nearest_law_fails(
    tmp_path: Path,
) -> None:
    law = laws.law([laws.term(laws.declared(tmp_path), "u", "u")], [0.1])
    unexplained: Cause = {"kind": "outside-library", "probability": None, "where": None}
    extended: Cause = {**unexplained, "terms": ["u: u"]}
    assert not is_law_contradicted("outside-library", [unexplained], law, [WORSE])
    assert is_law_contradicted("outside-library", [extended], law, [WORSE])


@pytest.mark.parametrize(
    ("misfits", "is_local", "expected"),
    [
        ({"s1": 9.0}, False, "other-sensors"),
        ({"s1": np.inf, "s2": 4.0, "s3": 1.0}, False, "other-sensors"),
        ({"s1": 1.0}, True, "other-sensors"),
        # A test sensor may err itself.
        ({"s1": 30.0, "s2": 1.0, "s3": 1.1}, False, None),
        ({}, False, None),
    ],
)
def test_sensor_faults_alone_are_contradicted_if_other_sensors_disagree(
    misfits: dict[str, float], is_local: bool, expected: FaultContradiction | None
) -> None:
    assert contradiction_of_faults([], misfits, is_local, 0.01) == expected


@pytest.mark.parametrize(
    ("errors", "noise", "expected"),
    [
        ([0.4], 0.1, None),
        ([1.3], 0.5, "no-better-than-mean"),
        ([1.3, np.inf], 0.5, "no-better-than-mean"),
        ([1.3, 0.4], 0.5, None),
        # Of readings that are noise alone, the error is 1.
        ([1.05], 0.95, None),
    ],
)
def test_a_simulator_that_is_no_better_than_a_constant_contradicts_sensor_faults(
    errors: list[float], noise: float, expected: FaultContradiction | None
) -> None:
    found = [compared(error, error) for error in errors]
    assert contradiction_of_faults(found, {}, False, noise) == expected
