"""Sensors on scattered nodes."""

from __future__ import annotations

from pathlib import Path

import pytest
import torch

from dashred.core.errors import InputError
from dashred.data.observation_operator import ObservationOperator
from dashred.data.sensors import Sensor
from dashred.physics.grids.mesh import Mesh
from dashred.physics.system import System, Term
from dashred.physics.terms.library import default_terms, evaluate_terms
from tests.config.checks.test_nodes import PLATE, TRUST, load


@pytest.fixture
def plate(tmp_path: Path) -> System:
    text = PLATE.replace("  start:", "  let: {q: 2*T + x}\n  start:")
    config = load(tmp_path, text, TRUST)
    return System(config.system, config.where)


def state(plate: System) -> torch.Tensor:
    x, y = plate.grid.coordinates.values()
    return (x * y**2)[None, None].repeat(3, 1, 1)


def test_sensors_read_between_the_nodes(plate: System) -> None:
    places = [(0.31, 0.72), (1.0, 0.5), (0.2, 0.2)]
    sensors = [Sensor(f"s{i}", "q" if i else "T", place) for i, place in enumerate(places)]
    operator = ObservationOperator(sensors, plate)
    assert operator.rank == 1
    found = operator(state(plate))
    exact = [0.31 * 0.72**2, 2 * 0.25 + 1, 2 * 0.008 + 0.2]
    torch.testing.assert_close(
        found, torch.tensor([exact] * 3, dtype=torch.float64), atol=1e-9, rtol=0
    )
    # The operator is linear.
    twice = operator(2 * state(plate))[:, 0]
    torch.testing.assert_close(twice, 2 * found[:, 0])


def test_a_sensor_that_averages(plate: System) -> None:
    sensor = Sensor("s", "T", (0.5, 0.4), widths=(0.6, 0.2))
    found = ObservationOperator([sensor], plate)(state(plate))
    assert float(found[0, 0]) == pytest.approx(0.5 * (0.4**2 + 0.2**2 / 12), abs=1e-9)


@pytest.mark.parametrize(
    ("sensor", "message"),
    [
        (Sensor("s", "T", (0.5, 1.2)), "s' is at y = 1.2, outside the axis"),
        (Sensor("s", "T", (0.1, 0.9)), "reads at (0.1, 0.9), outside the mesh"),
        (Sensor("s", "T", (0.5, 0.45), widths=(0.8, 0.1)), "outside the mesh"),
        (Sensor("s", "T", (0.5,)), "has 1 coordinates"),
    ],
)
def test_places_outside_are_refused(plate: System, sensor: Sensor, message: str) -> None:
    mesh = plate.grid
    assert isinstance(mesh, Mesh)
    plate.grid = Mesh(mesh.names, mesh.nodes[mesh.nodes[:, 0] >= mesh.nodes[:, 1]])
    with pytest.raises(InputError) as error:
        ObservationOperator([sensor], plate)
    assert message in str(error.value)


def test_default_terms_have_stencils(plate: System) -> None:
    terms = default_terms(plate)
    assert "lap(T)" in terms
    assert "T*d(T, y)" in terms
    assert not [text for text in terms if "inv_lap" in text or "lap(lap" in text]
    library = [Term("T", plate.parse(text, text)) for text in terms]
    columns = evaluate_terms(plate, library, state(plate), torch.zeros(3).double())
    assert columns.shape == (len(terms), 3, *plate.grid.shape)
    assert bool(columns.isfinite().all())
    lap = columns[terms.index("lap(T)"), 0]
    torch.testing.assert_close(lap, 2 * plate.grid.coordinates["x"], atol=1e-7, rtol=0)
