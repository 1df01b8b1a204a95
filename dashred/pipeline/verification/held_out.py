"""RMSE on held-out data: test sensors, held-out time, and held-out episodes."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping, Sequence

import numpy as np
from torch import Tensor

from dashred.core.findings.methods import AT_SENSORS
from dashred.core.findings.schema import HeldOut, errors_by_method
from dashred.inference.fit.law import Law
from dashred.pipeline.analysis import Analysis
from dashred.pipeline.problem import Problem
from dashred.pipeline.verification.restart import restart

# By method: the RMSE, and over how many values it is.
Errors = dict[str, tuple[float, int]]


def held_out_errors(problem: Problem, analysis: Analysis) -> HeldOut:
    """Return the RMSE of every method: at the test sensors, in the held-out time, and on.

    Of several episodes over all samples together.
    """
    episodes = analysis.episodes(problem)
    results = HeldOut(
        test_sensors=errors_by_method(**_pooled_rmse(_test_errors, episodes)),
        heldout_time=errors_by_method(**_pooled_rmse(_heldout_errors, episodes)),
        heldout_restarted=errors_by_method(**_pooled_rmse(_restarted_errors, episodes)),
    )
    if problem.whole:
        results["heldout_episode"] = errors_by_method(**_held_out_episode_errors(problem, analysis))
    return results


def _pooled_rmse(
    errors: Callable[[Problem, Analysis], Errors], episodes: Sequence[tuple[Problem, Analysis]]
) -> dict[str, float]:
    """Return the RMSE of each method pooled over the samples of all episodes."""
    results = [errors(problem, analysis) for problem, analysis in episodes]
    if len(results) == 1:
        return {name: rmse for name, (rmse, _) in results[0].items()}
    pooled = {}
    for name in results[0]:
        seen = [(rmse, count) for rmse, count in (each[name] for each in results) if count]
        total = sum(count for _, count in seen)
        squares = sum(rmse**2 * count for rmse, count in seen)
        pooled[name] = math.sqrt(squares / total) if total else math.nan
    return pooled


def _test_errors(problem: Problem, analysis: Analysis) -> Errors:
    split = problem.split
    tested = split.tested.between(float(problem.times[0]), split.time_end)
    if not tested.sensors:
        return {}
    operator, scale = problem.operator(tested), tested.trace_scale()
    count = int((~np.isnan(tested.values)).sum())
    return {
        name: (relative_rmse(operator(states).numpy(), tested.values, scale), count)
        for name, states in analysis.estimates(len(tested.times)).items()
        if name in AT_SENSORS
    }


def _heldout_errors(problem: Problem, analysis: Analysis) -> Errors:
    total = len(problem.times)
    begin = total - len(problem.split.heldout.times)
    ends = {"simulation": analysis.nominal.states, **analysis.trajectories.states}
    runs = {name: states[begin:total] for name, states in ends.items()}
    return _errors_at_heldout_times(problem, runs, [problem], analysis.discovery.best)


def _restarted_errors(problem: Problem, analysis: Analysis) -> Errors:
    corrected = analysis.trajectories.states["corrected"][: len(problem.split.fit.times)]
    best = analysis.discovery.best
    restarted = restart(problem, best, corrected)
    return _errors_at_heldout_times(problem, restarted, [problem], best)


def _held_out_episode_errors(problem: Problem, analysis: Analysis) -> dict[str, float]:
    """Return the RMSE of free runs after the fitted beginning of the held-out episode."""
    [whole], [simulated], [free] = (
        problem.whole,
        analysis.nominal.whole,
        analysis.trajectories.whole,
    )
    ends = slice(len(whole.split.fit.times), len(whole.times))
    states = {"simulation": simulated, **free.states}
    runs = {name: path[ends] for name, path in states.items()}
    best = analysis.discovery.best
    errors = _errors_at_heldout_times(whole, runs, problem.episodes, best)
    return {name: rmse for name, (rmse, _) in errors.items()}


def _errors_at_heldout_times(
    problem: Problem, runs: Mapping[str, Tensor], fitted: Sequence[Problem], law: Law
) -> Errors:
    """Return the RMSE over the held-out time, in std of each trace in the fit window.

    Sensors that the law tells to be faulty are left out, unless all are.
    """
    heldout = problem.split.heldout
    faulty = {fault.sensor for fault in law.faults}
    if sound := [name for name in heldout.names if name not in faulty]:
        heldout = heldout.select(sound)
    scale = np.array([_fitted_std(name, fitted) for name in heldout.names])
    operator = problem.operator(heldout)
    count = int((~np.isnan(heldout.values)).sum())
    return {
        name: (relative_rmse(operator(states).numpy(), heldout.values, scale), count)
        for name, states in runs.items()
    }


def _fitted_std(name: str, fitted: Sequence[Problem]) -> float:
    """Return the std of a trace in the fit window, as rms over several episodes."""
    stds = []
    for problem in fitted:
        split = problem.split
        part = split.fit if name in split.fit.names else split.validation
        stds.append(float(part.select([name]).trace_scale()[0]))
    return stds[0] if len(stds) == 1 else math.sqrt(sum(std**2 for std in stds) / len(stds))


def relative_rmse(read: np.ndarray, recorded: np.ndarray, scale: np.ndarray) -> float:
    """Return the RMSE over all sensors in units of their std; infinite if a run blows up.

    Only missing recorded samples are excluded; simulated values that are not finite are included.
    """
    seen = ~np.isnan(recorded)
    if not seen.any():
        return math.nan
    with np.errstate(over="ignore"):
        rmse = float(np.sqrt(np.mean(np.square(((read - recorded) / scale)[seen]))))
    return math.inf if math.isnan(rmse) else rmse
