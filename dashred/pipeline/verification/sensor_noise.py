"""Standard deviation of the noise of all sensors, also of those that no fit has used."""

from __future__ import annotations

from collections.abc import Sequence
from statistics import median

from dashred.data.noise_level import noise_std
from dashred.pipeline.analysis import Analysis
from dashred.pipeline.problem import Problem


def noise_of_sensors(
    problem: Problem, analysis: Analysis, names: Sequence[str]
) -> dict[str, float]:
    """Return σ of the noise of each named sensor.

    σ of a fitted sensor is that of the residuals. σ of another sensor is the stated one, or an
    estimate from its traces, times the median ratio of both at the fitted sensors.
    """
    # The noise is the same in all episodes.
    found = dict(zip(problem.split.fit.names, analysis.discovery.noise.std.tolist(), strict=False))
    stated = problem.noise | _noise_of_test_sensors(problem)
    ratio = median(std / stated[name] for name, std in found.items())
    return {name: found.get(name, ratio * stated[name]) for name in names}


def _noise_of_test_sensors(problem: Problem) -> dict[str, float]:
    """Return σ of every test sensor, stated or estimated from its traces in the fit window."""
    if not problem.split.test:
        return {}
    traces = [e.split.tested.between(float(e.times[0]), e.split.time_end) for e in problem.episodes]
    return dict(zip(traces[0].names, noise_std(*traces).tolist(), strict=True))
