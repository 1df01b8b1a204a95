"""Invented records of cases."""

from __future__ import annotations

import random
from typing import Any, cast

from dashred.evaluation.proof.cases.case_record import KINDS, CaseRecord, Coefficient, Gains
from dashred.evaluation.proof.scoring.outcomes import TRUE_CAUSE


def case(number: int = 0, kind: str = "terms", **more: Any) -> CaseRecord:
    """Return the record of a case that went well in every respect."""
    law = kind not in ("null", "start", "numerics", "fault")
    window = kind if kind in ("box", "gate", "onset") else None
    region = {"overlap": None, "onset": None, "threshold": None, "threshold_z": None}
    found = {"box": {"overlap": 0.96}, "onset": {"onset": 0.01}, "gate": {"threshold": 0.02}}
    told = TRUE_CAUSE[cast(Any, kind)] if kind != "masked" else "missing-term"
    record = {
        "number": number,
        "system": "fhn",
        "group": "cases",
        "kind": kind,
        "noise": 0.03,
        "sensors": 12,
        "hidden": "u: -0.15*u**2 for 10 < x < 16",
        "told": "quadratic damping of u",
        "mismatch": 4.2,
        "verdict": told,
        "probability": 0.97,
        "causes": [told],
        "right": True,
        "listed": True,
        "exact": True if law else None,
        "flagged": False,
        "problem": None,
        "equation_right": True if kind == "hidden" else None,
        "region": region | found[kind] if window else None,
        "peak_inside": True if kind == "box" else None,
        "coefficients": [coefficient(window=window)] if law else [],
        "oracle": {
            "over_null": 200.0,
            "over_rival": 30.0,
            "decidable": True,
            "lost": -0.2,
            "over_library": 50.0,
        },
        "gains": gaining(8.0, 20.0) if law else None,
        "noisy_test": -0.4 if law else None,
        "seconds": 61.2,
    }
    return cast(CaseRecord, record | more)


def gaining(test_sensors: float | None, forecast: float | None) -> Gains:
    """Return gains, over the simulation from the same start twice those over its best one."""
    twice = [None if gain is None else 2 * gain for gain in (test_sensors, forecast)]
    return Gains(
        test_sensors=test_sensors,
        forecast=forecast,
        test_sensors_before=twice[0],
        forecast_before=twice[1],
    )


def null(number: int = 0, **more: Any) -> CaseRecord:
    """Return the record of a null on which nothing was found."""
    fixed: dict[str, Any] = {"group": "nulls", "hidden": "nothing", "oracle": None}
    return case(number, "null", **fixed | more)


def coefficient(**more: Any) -> Coefficient:
    """Return a coefficient that was found well."""
    found = {"name": "u: u**2", "true": -0.15, "found": -0.151, "std": 0.001, "window": None}
    whole: dict[str, Any] = found | more
    away = abs(whole["found"] - whole["true"])
    return cast(Coefficient, {"covered": away <= 1.96 * (whole["std"] or 0.0)} | whole)


def dead(number: int = 0, kind: str = "terms") -> CaseRecord:
    """Return the record of a case that crashed: it has no findings, and nothing to score."""
    nothing = dict.fromkeys(
        ("verdict", "probability", "exact", "equation_right", "region", "peak_inside", "oracle")
    )
    nothing |= dict.fromkeys(("gains", "noisy_test", "seconds"))
    wrong = {"right": False, "listed": False, "causes": [], "coefficients": [], "told": ""}
    return case(number, kind, problem="exit code -9", **nothing, **wrong)


def wrong(number: int = 0, kind: str = "terms", **more: Any) -> CaseRecord:
    """Return the record of a case with a wrong, unflagged verdict."""
    told: dict[str, Any] = {"right": False, "listed": False, "exact": False, "coefficients": []}
    told |= {"verdict": "parameter", "causes": ["parameter"], "told": "b is 0.7, not 0.8"}
    return case(number, kind, **told | more)


def proof() -> list[CaseRecord]:
    """Return a whole proof in which most went well: some wrong, ambiguous, and dead."""
    dice = random.Random(7)
    records = [_drawn(number, list(KINDS)[number % 12], dice) for number in range(120)]
    records += [null(number) for number in range(99)]
    return [*records, wrong(99, "null", group="nulls", oracle=None)]


def _drawn(number: int, kind: str, dice: random.Random) -> CaseRecord:
    chance = dice.random()
    if chance < 0.02:
        return dead(number, kind)
    if chance < 0.12:
        return wrong(number, kind, flagged=chance < 0.1, probability=dice.uniform(0.4, 1.0))
    more: dict[str, Any] = {"probability": dice.uniform(0.9, 1.0), "seconds": dice.uniform(30, 90)}
    whole = case(number, kind)
    if chance < 0.22:
        more |= {"verdict": "ambiguous", "right": False, "flagged": True}
        more["probability"] = dice.uniform(0.4, 0.9)
    if whole["coefficients"]:
        window = whole["coefficients"][0]["window"]
        drawn = [-0.15 + dice.gauss(0.0, 0.002) for _ in range(dice.randint(1, 3))]
        more["coefficients"] = [coefficient(found=c, std=0.002, window=window) for c in drawn]
        gain = dice.lognormvariate(2.0, 0.8)
        more["gains"] = gaining(gain, gain * dice.lognormvariate(1.0, 0.5))
    return case(number, kind, **more)
