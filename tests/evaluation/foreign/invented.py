"""Invented findings and rows."""

from __future__ import annotations

import dataclasses
import tempfile
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any, cast

import yaml

from dashred.config import load_config
from dashred.evaluation.foreign.cases.case import Case
from dashred.evaluation.foreign.rows import Row
from dashred.evaluation.foreign.score_case import empty_row
from dashred.physics.system import System

DECAY = {
    "title": "Decay",
    "fields": {"x": "amount", "y": "other amount"},
    "parameters": {"k": 0.5},
    "equations": {"x": "-k*x", "y": "x - y"},
    "start": {"x": 1.0, "y": 0.0},
    "spread": {"x": 0.1, "y": 0.1},
    "integrator": {"method": "rk4", "dt": 0.01},
}
RING = {
    "title": "Ring",
    "axes": {"x": {"length": 10, "points": 40}},
    "fields": {"u": "amount"},
    "equations": {"u": "0.1*lap(u)"},
    "start": {"u": "1"},
    "spread": {"u": 0.1},
    "integrator": {"dt": 0.01},
}


def config_of(section: Mapping[str, Any]) -> Any:
    """Return the configuration of a section ``system``."""
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / "case.yaml"
        recording = {"path": "recording.csv"}
        path.write_text(
            yaml.safe_dump({"system": dict(section), "recording": recording}, sort_keys=False)
        )
        return load_config([f"conf={path}"], entry="train")


def system_of(section: Mapping[str, Any]) -> System:
    """Return the simulator of a section ``system``."""
    config = config_of(section)
    return System(config.system, config.where)


def term(equation: str, text: str, coefficient: float, **more: Any) -> dict[str, Any]:
    """Return a term as findings hold it."""
    std = 0.01 * abs(coefficient)
    interval = [coefficient - 2 * std, coefficient + 2 * std]
    known = {"equation": equation, "term": text, "coefficient": coefficient, "std": std}
    return {**known, "ci95": interval, "inclusion": 1.0, "region": None, **more}


def findings_of(
    section: Mapping[str, Any],
    verdict: str | None,
    terms: Sequence[Mapping[str, Any]] = (),
    causes: Sequence[Mapping[str, Any]] = (),
    **more: Any,
) -> dict[str, Any]:
    """Return findings with the keys that are scored."""
    errors = {"simulation_refit": 0.4, "corrected": 0.1}
    return {
        "verdict": verdict,
        "terms": list(terms),
        "causes": list(causes) or [{"kind": verdict, "probability": 0.97}],
        "alternatives": [],
        "smaller": [],
        "where": None,
        "fit": {"test_sensors": errors, "heldout_time": errors},
        "input": {"config": {"system": dataclasses.asdict(config_of(section).system)}},
        **more,
    }


def row(name: str = "a", **more: Any) -> Row:
    """Return the row of a case that went well."""
    case = Case("dysts", name, "term", 0, 0.02, 7)
    known: dict[str, Any] = {
        "hidden": "x: +1·y",
        "verdict": "missing-term",
        "told": "missing-term: x: +1·y",
        "outcome": "right",
        "leading_right": True,
        "probability": 0.99,
        "covered": [True],
        "gain_sensors": 3.0,
        "gain_time": 2.0,
        "seconds": 10.0,
        "wall": 11.0,
    }
    return cast(Row, {**empty_row(case, None), **known, **more})
