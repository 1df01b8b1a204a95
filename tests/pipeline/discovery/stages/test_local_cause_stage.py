"""A source and a term in a region are told without a fit of all candidates."""

from __future__ import annotations

import json
from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest
import torch

from tests.pipeline.simulation.conftest import SHORT_RUN
from tests.ring_recording import write_ring_recording

SYSTEM = """
system:
  title: a channel
  axes: {x: {length: 10, points: 48}}
  fields: {c: concentration}
  equations: {c: "-0.5*d(c, x) + 0.08*lap(c) - 0.1*cHIDDEN"}
  start: {c: 0.5 + 0.3*cos(2*pi*x/10)}
  spread: {c: 0.02, length: 2}
  integrator: {dt: 0.05}
"""
REST = (
    """
library: {c: ["1", c, c**2, "d(c, x, 3)"]}
recording: {path: recording.csv, sensors: sensors.csv}
splits: {sensors: {validate: 1, test: 1, extra: 0}}
simulation: {members: 16, held_out: 4, terms: 1}"""
    + SHORT_RUN
)
TIMES = torch.linspace(0, 8, 81, dtype=torch.float64)
SENSORS, NOISE = 12, 0.004
SOURCE = " + 0.3*exp(6*(cos(2*pi*(x - 8.2)/10) - 1))"
REGION = " - 0.25*c*(tanh((x - 3)/0.2) - tanh((x - 6)/0.2))"


def findings_without_a_horizon(
    folder: Path, train, hidden: str, change: Callable[[list[list[str]]], None] | None = None
) -> dict[str, Any]:
    """Return the findings of a run, which must not have grown a horizon.

    Args:
        folder: gets the files.
        train: runs the command.
        hidden: what the simulator lacks.
        change: changes the rows of the recording.
    """
    complete = SYSTEM.replace("HIDDEN", hidden)
    write_ring_recording(folder, complete, (0.51, 0.29), TIMES, SENSORS, NOISE)
    if change is not None:
        lines = (folder / "recording.csv").read_text(encoding="utf-8").splitlines()
        rows = [line.split(",") for line in lines]
        change(rows)
        (folder / "recording.csv").write_text("\n".join(map(",".join, rows)), encoding="utf-8")
    (folder / "channel.yaml").write_text(SYSTEM.replace("HIDDEN", "") + REST, encoding="utf-8")
    path = folder / "recording.csv"
    ended = train(f"conf={folder / 'channel.yaml'}", f"recording.path={path}")
    assert ended.code == 0, ended.err
    assert "grow the horizon" not in ended.out
    return json.loads(ended.read("findings.json"))


@pytest.mark.slow
def test_a_source(tmp_path: Path, train) -> None:
    findings = findings_without_a_horizon(tmp_path, train, SOURCE)
    assert findings["verdict"] == "outside-library"
    source = findings["where"]["source"]
    assert source["equation"] == "c" and source["period"] is None
    assert source["place"][0] == pytest.approx(8.2, abs=0.15)
    assert findings["where"]["forcing"]["peak"][0] == pytest.approx(8.2, abs=0.6)


@pytest.mark.slow
def test_a_term_in_a_region(tmp_path: Path, train) -> None:
    findings = findings_without_a_horizon(tmp_path, train, REGION)
    assert findings["verdict"] == "missing-term"
    [term] = findings["terms"]
    assert (term["equation"], term["term"]) == ("c", "c")
    assert term["coefficient"] == pytest.approx(-0.5, rel=0.1)
    [region] = term["region"]
    assert (region["axis"], region["from"], region["to"]) == (
        "x",
        pytest.approx(3, abs=0.2),
        pytest.approx(6, abs=0.2),
    )


@pytest.mark.slow
def test_a_biased_sensor(tmp_path: Path, train) -> None:
    """A wrong sensor drags the start so far that no law follows the recording."""

    def bias(rows: list[list[str]]) -> None:
        column = rows[0].index("s5")
        for row in rows[1:]:
            row[column] = repr(float(row[column]) + 0.15)

    findings = findings_without_a_horizon(tmp_path, train, "", bias)
    assert findings["verdict"] == "sensor-fault"
    fault = findings["causes"][0]
    assert (fault["sensor"], fault["fault"]) == ("s5", "bias")
    assert fault["value"] == pytest.approx(0.15, abs=0.01)
