"""Standard deviation of the noise of all sensors, also of those that no fit has used."""

from __future__ import annotations

import torch
from torch import Tensor

from dashred.data.noise_level import noise_std
from dashred.pipeline.analysis import Analysis
from dashred.pipeline.problem import Problem


def noise_of_sensors(problem: Problem, analysis: Analysis, names: tuple[str, ...]) -> Tensor:
    """Return σ of the noise of each sensor, ``(sensor,)``.

    σ of a fitted sensor is that of the residuals. σ of another sensor is the stated one, or an
    estimate from its traces, times the median ratio of both at the fitted sensors.
    """
    fitted = problem.split.fit.names
    found = analysis.discovery.noise.std[: len(fitted)]
    stated = problem.noise | _noise_of_test_sensors(problem)
    ratio = (found / torch.tensor([stated[name] for name in fitted], dtype=torch.float64)).median()
    others = torch.tensor([stated[name] for name in names], dtype=torch.float64)
    by_name = dict(zip(fitted, found, strict=True))
    values = [by_name.get(name, ratio * other) for name, other in zip(names, others, strict=True)]
    return torch.stack(values)


def _noise_of_test_sensors(problem: Problem) -> dict[str, float]:
    """Return σ of every test sensor, stated or estimated from its traces in the fit window."""
    if not problem.split.test:
        return {}
    traces = [e.split.tested.between(float(e.times[0]), e.split.time_end) for e in problem.episodes]
    return dict(zip(traces[0].names, noise_std(*traces).tolist(), strict=True))
