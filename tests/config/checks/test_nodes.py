"""What cannot be declared together with nodes."""

from __future__ import annotations

from pathlib import Path

import pytest

from dashred.config import load_config
from dashred.core.errors import InputError
from tests.physics.grids.test_nodes_file import LINES, written

PLATE = """\
system:
  title: Plate
  nodes: nodes.csv
  fields: {T: temperature}
  simulator: {function: tests.programs.heat}
  start: {T: 1 + x}
  integrator: {dt: 0.1}
recording: {path: recording.csv}
"""
TRUST = "trust=tests.programs.heat"
BY_PROGRAM = "  simulator: {function: tests.programs.heat}\n"


def load(folder: Path, text: str, *words: str):
    written(folder, LINES)
    (folder / "plate.yaml").write_text(text)
    return load_config([f"conf={folder / 'plate.yaml'}", *words], entry="check")


def test_the_coordinates_are_names(tmp_path: Path) -> None:
    system = load(tmp_path, PLATE, TRUST).system
    assert list(system.axes) == ["x", "y"]
    assert system.axes["x"].length == pytest.approx(1.0)
    assert system.nodes == str(tmp_path / "nodes.csv")


@pytest.mark.parametrize(
    ("old", "new", "message", "line"),
    [
        (BY_PROGRAM, "  equations: {T: lap(T)}\n", "equations need axes", 3),
        (
            "  fields:",
            "  axes: {x: {length: 1, points: 8, ends: insulated}}\n  fields:",
            "the program has its own conditions at its boundaries",
            3,
        ),
        ("function: tests.programs.heat", "fmu: a.fmu", "it has no nodes", 3),
        ("  start: {T: 1 + x}", "  start: {T: 1 + z}", "unknown name 'z'", 6),
        ("  start: {T: 1 + x}", '  start: {T: "d(x, x, 3)"}', "not available on nodes", 6),
        ("recording:", 'library: {T: ["lap(lap(T))"]}\nrecording:', "not available on nodes", 8),
        ("recording:", "library: {T: [inv_lap(T)]}\nrecording:", "not available on nodes", 8),
        ("  fields:", "  front: T\n  fields:", "system.front needs", 4),
        (
            "  fields:",
            '  structure: {H: T**2/2, J: {T: {T: "0"}}}\n  fields:',
            "system.structure is the form of equations",
            4,
        ),
        ("nodes.csv", "other.csv", "the nodes cannot be read", None),
    ],
)
def test_what_is_refused(tmp_path: Path, old: str, new: str, message: str, line) -> None:
    assert old in PLATE
    with pytest.raises(InputError) as error:
        load(tmp_path, PLATE.replace(old, new), TRUST)
    assert message in str(error.value)
    if line is not None:
        assert str(error.value.where).split(":")[1] == str(line)


def test_third_derivatives_in_a_let_and_a_term_together(tmp_path: Path) -> None:
    text = PLATE.replace("  start:", "  let: {q: lap(T)}\n  start:")
    text = text.replace("recording:", 'library: {T: ["d(q, x)"]}\nrecording:')
    with pytest.raises(InputError, match="not available on nodes"):
        load(tmp_path, text, TRUST)
