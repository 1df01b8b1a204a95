"""Write a case as a user would hand it in: ``case.yaml``, ``recording.csv``, ``sensors.csv``."""

from __future__ import annotations

import csv
import io
from pathlib import Path
from typing import Any

import yaml

from dashred.config import load_config
from dashred.core.files.atomic import write_text_atomic
from dashred.core.findings.findings import write_json_atomic
from dashred.evaluation.foreign.cases.case import MadeCase, Truth
from dashred.physics.system import System

CONFIG, RECORDING, SENSORS = "case.yaml", "recording.csv", "sensors.csv"


def write_case(folder: Path, made: MadeCase) -> None:
    """Write the files of a case into a folder; nothing in them comes from the hidden part."""
    recording: dict[str, Any] = {"path": RECORDING}
    places = [list(axis) for axis in made.system.get("axes", {})]
    plain = all(sensor.name == sensor.field for sensor in made.sensors)
    if not plain or places:
        recording["sensors"] = SENSORS
        header = ["name", "field", *made.system.get("axes", {})]
        rows = [[s.name, s.field, *(f"{x:.6g}" for x in s.position)] for s in made.sensors]
        write_text_atomic(folder / SENSORS, _csv([header, *rows]))
    config: dict[str, Any] = {"system": dict(made.system)}
    if made.library is not None:
        config["library"] = {name: list(terms) for name, terms in made.library.items()}
    text = yaml.safe_dump(config | {"recording": recording}, sort_keys=False, width=100)
    write_text_atomic(folder / CONFIG, text)
    rows = [
        [f"{time:.10g}", *(f"{value:.8g}" for value in values)]
        for time, values in zip(made.truth.times, made.readings, strict=True)
    ]
    header = ["time", *(sensor.name for sensor in made.sensors)]
    write_text_atomic(folder / RECORDING, _csv([header, *rows]))


def read_simulator(folder: Path) -> System:
    """Return the simulator of a written case, its fields in the order of the truth."""
    config = load_config([f"conf={folder / CONFIG}"], entry="train")
    return System(config.system, config.where)


def write_truth(path: Path, truth: Truth) -> None:
    """Write what was hidden, without the states, which can be made again from the draw."""
    write_json_atomic(
        path,
        {
            "kind": truth.kind,
            "says": truth.says,
            "terms": [[t.equation, t.term, t.coefficient] for t in truth.terms],
            "region": truth.region,
            "period": truth.period,
            "sensor": truth.sensor,
        },
    )


def _csv(rows: list[list[str]]) -> str:
    text = io.StringIO()
    csv.writer(text, lineterminator="\n").writerows(rows)
    return text.getvalue()
