"""Wandering sensors that are next to each other are told apart from distant ones."""

from __future__ import annotations

from types import SimpleNamespace
from typing import Any, cast

import pytest

from dashred.data.sensors import Sensor
from dashred.inference.hypotheses.comparison.faults_beside_laws import has_neighbouring_curves
from dashred.physics.grids.grid import Axis

SENSORS = tuple(Sensor(f"s{j}", "u", (float(j),)) for j in range(8))


@pytest.mark.parametrize(
    ("faults", "expected"),
    [
        ({"s2": "wandering", "s3": "wandering"}, True),
        ({"s2": "wandering", "s5": "wandering"}, False),
        ({"s2": "wandering", "s3": "bias"}, False),
        ({}, False),
    ],
)
def test_only_curves_of_neighbours_count(faults: dict[str, str], expected: bool) -> None:
    told = [SimpleNamespace(sensor=name, kind=kind) for name, kind in faults.items()]
    system = SimpleNamespace(axes=(Axis("x", 8.0, 16),))
    model = SimpleNamespace(
        sensors=SimpleNamespace(operator=SimpleNamespace(sensors=SENSORS)),
        simulator=SimpleNamespace(system=system),
    )
    fit = SimpleNamespace(
        objective=SimpleNamespace(forward_model=model), law=SimpleNamespace(faults=told)
    )
    assert has_neighbouring_curves(cast(Any, fit)) is expected
