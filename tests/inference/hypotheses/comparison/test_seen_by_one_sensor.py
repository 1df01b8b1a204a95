"""A source that no other sensor sees is a fault of the one that does."""

from __future__ import annotations

from dataclasses import replace
from types import SimpleNamespace
from typing import Any

import pytest
import torch
from torch import Tensor

from dashred.inference.fit.noise_model import NoiseModel
from dashred.inference.hypotheses.comparison.faults_beside_laws import SEEN, is_seen_by_one_sensor

SIGMA, SAMPLES = 0.1, 50
SENSORS = [SimpleNamespace(name=name) for name in ("a", "b", "c")]


def residuals(unexplained: tuple[float, float, float], episodes: int = 1) -> Tensor:
    """Return residuals of noise, whose sum of squares at each sensor is larger by this many σ²."""
    sizes = torch.tensor([1 + part / SAMPLES for part in unexplained]).double().sqrt()
    return SIGMA * sizes.repeat(episodes).expand(SAMPLES, -1) / episodes**0.5


def fit(found: Tensor, faulty: tuple[str, ...] = (), chi2: float = 1.0) -> Any:
    faults = [SimpleNamespace(sensor=name) for name in faulty]
    law = SimpleNamespace(
        candidates=(), faults=faults, chi2=chi2, residuals=found, score=chi2 * 3 * SAMPLES
    )
    columns = found.shape[1]
    block = SimpleNamespace(
        operator=SimpleNamespace(sensors=SENSORS),
        columns_of=lambda column: range(column, columns, len(SENSORS)),
    )
    model = SimpleNamespace(sensors=block)
    std = torch.full((columns,), SIGMA, dtype=torch.float64)
    noise = NoiseModel(std, torch.zeros_like(std), torch.ones(found.shape, dtype=torch.bool))
    return SimpleNamespace(law=law, objective=SimpleNamespace(forward_model=model, noise=noise))


@pytest.mark.parametrize("episodes", [1, 2])
def test_a_source_is_seen_by_other_sensors_if_their_misfit_is_lower(episodes: int) -> None:
    source, null = (fit(residuals((each, 0, 0), episodes)) for each in (0, 400))
    for gain, alone in ((0.5 * SEEN, True), (1.5 * SEEN, False)):
        # What the fault leaves at its own sensor does not count.
        fault = fit(residuals((40.0, gain, 0.0), episodes), ("a",), 1.05)
        assert is_seen_by_one_sensor(source, [null, fault]) is alone


def test_faults_of_several_sensors_or_an_unexplained_recording_do_not_count() -> None:
    source, left = fit(residuals((0, 0, 0))), residuals((0, 0, 0))
    assert not is_seen_by_one_sensor(source, [fit(left), fit(left, ("a", "b"))])
    assert not is_seen_by_one_sensor(source, [fit(left, ("a",), 1.5)])
    assert is_seen_by_one_sensor(source, [fit(left, ("a", "a"))])


def test_missing_readings_do_not_count() -> None:
    left = residuals((0, 200, 0))
    left[:, 1] = torch.nan
    assert is_seen_by_one_sensor(fit(residuals((0, 0, 0))), [fit(left, ("a",))])


def test_readings_of_larger_noise_count_less() -> None:
    source, fault = fit(residuals((0, 0, 0))), fit(residuals((40.0, 1.5 * SEEN, 0.0)), ("a",))
    assert not is_seen_by_one_sensor(source, [fault])
    noise = fault.objective.noise
    fault.objective.noise = replace(noise, relative=torch.full((SAMPLES, 3), 2.0))
    assert is_seen_by_one_sensor(source, [fault])
