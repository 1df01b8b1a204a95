"""Figures and files of fields on scattered nodes."""

from __future__ import annotations

from pathlib import Path
from types import SimpleNamespace
from typing import Any, cast

import numpy as np
import torch

from dashred.data.sensors import Sensor
from dashred.physics.system import System
from dashred.pipeline.outputs.field_figures import draw_fields
from dashred.pipeline.outputs.field_files import fields_dataset
from tests.config.checks.test_nodes import PLATE, TRUST, load
from tests.physics.grids.test_stencils import scattered

TIMES = torch.linspace(0, 1, 5, dtype=torch.float64)


def drawn(system: System, position: tuple[float, ...]) -> Any:
    x = next(iter(system.grid.coordinates.values()))
    fit = SimpleNamespace(times=TIMES.numpy(), sensors=[Sensor("s", "T", position)])
    problem = SimpleNamespace(system=system, times=TIMES, split=SimpleNamespace(fit=fit))
    states = (TIMES[:, None] + x)[:, None]
    return draw_fields(cast(Any, problem), {"simulation": states, "corrected": 2 * states})


def test_a_field_in_the_plane(tmp_path: Path) -> None:
    config = load(tmp_path, PLATE, TRUST)
    figure = drawn(System(config.system, config.where), (0.3, 0.4))
    images = [image.get_array() for axes in figure.axes for image in axes.images]
    assert len(images) == 6
    # The last row is at t = 1: x + 1 from the left to the right.
    np.testing.assert_allclose(np.ma.filled(images[-2], np.nan)[50, [0, -1]], [1.0, 2.0])
    figure.savefig(tmp_path / "figure.png")


def test_a_field_on_a_line(tmp_path: Path) -> None:
    config = load(tmp_path, PLATE, TRUST)
    np.savetxt(tmp_path / "nodes.csv", 3 * scattered(20, 1) - 1, header="x", comments="")
    system = System(config.system, config.where)
    assert [axis.begin for axis in system.axes] == [-1.0]
    figure = drawn(system, (0.3,))
    [first, _] = [image.get_array() for axes in figure.axes for image in axes.images]
    np.testing.assert_allclose(first[[0, -1], 0], [-1.0, 2.0])
    figure.savefig(tmp_path / "figure.png")


def test_the_dataset_has_the_coordinates_of_the_nodes(tmp_path: Path) -> None:
    config = load(tmp_path, PLATE, TRUST)
    system = System(config.system, config.where)
    states = torch.zeros((5, 1, *system.grid.shape), dtype=torch.float64)
    found = fields_dataset(system, TIMES, {"corrected": states})
    assert found["T"].dims == ("method", "time", "node")
    np.testing.assert_array_equal(found["y"], system.grid.coordinates["y"])
    assert found["y"].dims == ("node",)
