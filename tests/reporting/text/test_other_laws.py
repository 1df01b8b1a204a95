"""Other laws are listed once, if they have other terms than the best one."""

from __future__ import annotations

from typing import Any

from dashred.reporting.text.laws import other_laws


def term(name: str, coefficient: float) -> dict[str, Any]:
    return {"equation": "v", "term": name, "coefficient": coefficient, "region": None}


def other(name: str, coefficient: float, delta_bic: float, same: bool = True) -> dict[str, Any]:
    return {
        "terms": [term(name, coefficient)],
        "delta_bic": delta_bic,
        "rival": True,
        "same_as_best": same,
    }


def test_a_law_that_differs_in_the_errors_of_sensors_alone_is_not_listed() -> None:
    others = [
        other("v**2", -0.000298, 0.03),
        other("z*v**2", -8.97e-7, 0.04),
        other("v**2", -0.000306, 0.3),
    ]
    [line] = other_laws({"terms": [term("z*v**2", -8.7e-7)], "alternatives": others})
    assert line.count("v²") == 1 and "−0.000298" in line
    same = {"terms": [term("v**2", -0.0003)], "alternatives": [others[0], others[2]]}
    assert other_laws(same) == []
