"""When what the global search left is trusted, and when not."""

from __future__ import annotations

from dataclasses import replace
from types import SimpleNamespace
from typing import Any, cast

import pytest
import torch

from dashred.inference.fit.noise_model import NoiseModel
from dashred.inference.initial_state.start_models import project_state
from dashred.pipeline.discovery import explained_record
from dashred.pipeline.problem import Problem
from tests import laws


@pytest.mark.parametrize(
    ("found", "stated", "inflated"), [(1.1, 1.0, False), (1.6, 1.0, True), (9.0, None, False)]
)
def test_noise_far_above_the_stated_one_is_no_noise(monkeypatch, found, stated, inflated) -> None:
    """What nobody stated may be as large as it likes: a real recording always has some misfit."""
    sensors = [SimpleNamespace(std=stated), SimpleNamespace(std=1.0)]
    split = SimpleNamespace(fit=SimpleNamespace(sensors=sensors))
    problem = cast(Problem, SimpleNamespace(split=split))
    believed = SimpleNamespace(std=torch.ones(2))
    monkeypatch.setattr(explained_record, "fit_noise", lambda _: believed)
    noise: Any = SimpleNamespace(std=torch.tensor([found, found]))
    assert explained_record.is_noise_inflated(problem, noise) is inflated


@pytest.mark.parametrize(
    ("early", "late", "factor", "explained"),
    [(9.0, 1.0, 4.0, True), (9.0, 1.6, 4.0, False), (9.0, 1.0, 1.0, False)],
)
def test_what_a_start_cannot_express_is_seen_in_the_first_samples(
    monkeypatch, early: float, late: float, factor: float, explained: bool
) -> None:
    shape = (laws.SAMPLES, laws.SENSORS)
    stated = NoiseModel(
        torch.ones(laws.SENSORS), torch.zeros(laws.SENSORS), torch.ones(shape, dtype=torch.bool)
    )
    monkeypatch.setattr(explained_record, "fit_noise", lambda _: stated)
    residuals = late * torch.ones(shape)
    residuals[:4] = early
    residuals[10, 0] = torch.nan
    start = replace(laws.law(widened=factor), residuals=residuals)
    problem = cast(Problem, SimpleNamespace())
    assert explained_record.is_start_explained(problem, start) is explained


def test_a_start_is_found_again_in_a_prior_that_is_not_linear() -> None:
    class Bent:
        size = 2

        def start(self, z: torch.Tensor) -> torch.Tensor:
            return torch.stack([z[:, 0].exp(), z[:, 1] + z[:, 0] ** 2], dim=1)[:, None]

    z = torch.tensor([0.7, -1.2], dtype=torch.float64)
    found = project_state(Bent(), Bent().start(z[None])[0])
    torch.testing.assert_close(found, z, atol=1e-4, rtol=0)
