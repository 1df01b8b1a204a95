"""Whole runs of a port-Hamiltonian system: findings say which part of it the mismatch changes."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import pytest

from tests.conftest import run_command

SMALL = (
    "simulation.members=24",
    "simulation.held_out=4",
    "shred.epochs=2",
    "surrogate.members=8",
)
TWINS = """
resistor: {terms: [{equation: phi, term: phi, coefficient: -0.15}]}
coil: {terms: [], parameters: {L: 1.1}}
port: {terms: [{equation: phi, term: V, coefficient: 0.2}]}
"""


def circuit(folder: Path) -> Path:
    """The bundled circuit with hidden truths of its own, one for each part."""
    (folder / "twins").mkdir()
    (folder / "twins" / "circuit.yaml").write_text(TWINS)
    path = folder / "circuit.yaml"
    path.write_text(Path("conf/rlc.yaml").read_text())
    return path


@pytest.mark.slow
@pytest.mark.parametrize(
    ("twin", "found", "part", "says"),
    [
        ("resistor", "phi", "R", "damping"),
        ("coil", "L", "H", "energy"),
        ("port", "V", "G", "port"),
    ],
)
def test_a_run_tells_the_part_that_is_wrong(
    twin: str, found: str, part: str, says: str, tmp_path: Path
) -> None:
    ended = run_command(tmp_path, f"conf={circuit(tmp_path)}", f"recording.twin={twin}", *SMALL)
    assert ended.code == 0, ended.err
    findings: dict[str, Any] = json.loads(ended.read("findings.json"))
    [term] = findings["terms"]
    assert found == term.get("parameter", term["term"])
    [change] = findings["structure"]["changes"]
    assert change["part"] == part
    assert findings["structure"]["port_hamiltonian"] is True
    assert says in ended.read("summary.txt").decode()
