"""Erring sensors that are next to each other are told apart from distant ones."""

from __future__ import annotations

from types import SimpleNamespace
from typing import Any, cast

import pytest

from dashred.data.sensors import Sensor
from dashred.inference.hypotheses.comparison.faults_beside_laws import has_neighbouring_faults
from dashred.physics.grids.grid import Axis

SENSORS = tuple(Sensor(f"s{j}", "u", (float(j),)) for j in range(8))


@pytest.mark.parametrize(
    ("faults", "expected"),
    [
        ({"s2": "wandering", "s3": "wandering"}, True),
        ({"s2": "wandering", "s5": "wandering"}, False),
        ({"s2": "misplaced", "s3": "bias"}, True),
        ({"s2": "wandering", "s3": "stuck"}, False),
        ({}, False),
    ],
)
def test_only_faults_that_a_law_may_imitate_count(faults: dict[str, str], expected: bool) -> None:
    told = [SimpleNamespace(sensor=name, kind=kind) for name, kind in faults.items()]
    system = SimpleNamespace(axes=(Axis("x", 8.0, 16),))
    model = SimpleNamespace(
        sensors=SimpleNamespace(operator=SimpleNamespace(sensors=SENSORS)),
        simulator=SimpleNamespace(system=system),
    )
    fit = SimpleNamespace(
        objective=SimpleNamespace(forward_model=model), law=SimpleNamespace(faults=told)
    )
    assert has_neighbouring_faults(cast(Any, fit)) is expected
