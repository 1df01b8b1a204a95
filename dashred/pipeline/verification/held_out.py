"""Predictions and RMSE on held-out data: test sensors, held-out time, and held-out episodes."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import replace

import numpy as np
from torch import Tensor

from dashred.core.findings.fit_schema import HeldOut, HeldOutData, errors_by_method
from dashred.core.findings.methods import AT_SENSORS
from dashred.data.recording import Recording
from dashred.pipeline.analysis import Analysis
from dashred.pipeline.problem import Problem
from dashred.pipeline.simulation.program_cost import follows_segments
from dashred.pipeline.verification.predictions import Array, Predictions, predict
from dashred.pipeline.verification.restart import restart

HeldOutPredictions = Mapping[HeldOutData, list[Predictions]]
"""Predictions by kind of held-out data: one for each episode, or several forecasts of each."""

# Last part of the fit in which a run of a chaotic system is lost if its error is larger than this,
# in standard deviations of the readings. That of an unrelated run is about 1.4.
LAST_SHARE, FEWEST, LOST = 0.05, 8, 0.5


def predict_held_out(problem: Problem, analysis: Analysis) -> HeldOutPredictions:
    """Return the predictions of every method for all held-out data."""
    episodes = analysis.episodes(problem)
    law = analysis.discovery.best
    found: dict[HeldOutData, list[Predictions]] = {
        "test_sensors": [_at_test_sensors(*each) for each in episodes],
        "heldout_time": [_in_heldout_time(*each) for each in episodes],
        "heldout_restarted": [part for each in episodes for part in _restarted(*each)],
    }
    if problem.whole:
        [whole], [simulated] = problem.whole, analysis.nominal.whole
        [free] = analysis.trajectories.whole
        ends = slice(len(whole.split.fit.times), len(whole.times))
        states = {"simulation": simulated, **free.states}
        runs = {name: path[ends] for name, path in states.items()}
        scale = _fitted_scale(whole, problem.episodes)
        found["heldout_episode"] = [
            predict(whole, whole.split.heldout, scale, law, runs, free.growth_rate)
        ]
    return found


def held_out_errors(predictions: HeldOutPredictions) -> HeldOut:
    """Return the RMSE of every method; of several episodes over all samples together.

    There is none of data without readings.
    """
    with_readings = {
        data: [part for part in parts if not np.isnan(part.recorded).all()]
        for data, parts in predictions.items()
    }
    rmse = {
        data: errors_by_method(
            **{
                method: pooled_rmse(parts, method)
                for method in AT_SENSORS
                if any(method in part.read for part in parts)
            }
        )
        for data, parts in with_readings.items()
    }
    errors = HeldOut(
        test_sensors=rmse["test_sensors"],
        heldout_time=rmse["heldout_time"],
        heldout_restarted=rmse["heldout_restarted"],
    )
    if "heldout_episode" in rmse:
        errors["heldout_episode"] = rmse["heldout_episode"]
    return errors


def held_out_samples(predictions: HeldOutPredictions) -> dict[HeldOutData, int]:
    """Return the number of times with readings of each kind of held-out data, if there are any."""
    counts = {
        data: sum(int((~np.isnan(part.recorded)).any(axis=1).sum()) for part in parts)
        for data, parts in predictions.items()
    }
    return {data: count for data, count in counts.items() if count}


def pooled_rmse(parts: Sequence[Predictions], method: str) -> float:
    """Return the RMSE of a method over all sensors and episodes, in units of the scales."""
    errors = np.concatenate([part.errors(method).ravel() for part in parts])
    is_missing = np.concatenate([np.isnan(part.recorded).ravel() for part in parts])
    return relative_rmse(errors, np.where(is_missing, np.nan, 0.0), np.ones(1))


def relative_rmse(read: Array, recorded: Array, scale: Array) -> float:
    """Return the RMSE over all sensors in units of their std; infinite if a run blows up.

    Only missing recorded samples are excluded; simulated values that are not finite are included.
    """
    seen = ~np.isnan(recorded)
    if not seen.any():
        return math.nan
    with np.errstate(over="ignore"):
        rmse = float(np.sqrt(np.mean(np.square(((read - recorded) / scale)[seen]))))
    return math.inf if math.isnan(rmse) else rmse


def _at_test_sensors(problem: Problem, analysis: Analysis) -> Predictions:
    split = problem.split
    tested = split.tested.between(float(problem.times[0]), split.time_end)
    estimates = analysis.estimates(len(tested.times)) if tested.sensors else {}
    states = {name: path for name, path in estimates.items() if name in AT_SENSORS}
    law, growth = analysis.discovery.best, analysis.trajectories.growth_rate
    return predict(problem, tested, tested.trace_scale(), law, states, growth)


def _in_heldout_time(problem: Problem, analysis: Analysis) -> Predictions:
    total = len(problem.times)
    begin = total - len(problem.split.heldout.times)
    ends = {"simulation": analysis.nominal.states, **analysis.trajectories.states}
    runs = {name: states[begin:total] for name, states in ends.items()}
    found = _over_heldout_time(problem, analysis, problem.split.heldout, runs)
    # Without forecasts from a state fitted just before, nothing else could contradict the law.
    has_forecasts = not follows_segments(problem)
    return replace(found, is_lost=has_forecasts and _is_lost(problem, analysis))


def _is_lost(problem: Problem, analysis: Analysis) -> bool:
    """Return whether the corrected run of a chaotic system is lost at the end of the fit.

    The law of such a recording is fitted over segments. No single run follows it, even with the
    right law, and later errors are those of chance.
    """
    fit, states = problem.split.fit, analysis.trajectories.states["corrected"]
    count = len(fit.times)
    first = count - max(FEWEST, round(LAST_SHARE * count))
    last = fit.samples(slice(max(first, 0), count))
    runs = {"corrected": states[max(first, 0) : count]}
    law, rate = analysis.discovery.best, analysis.trajectories.growth_rate
    end = predict(problem, last, fit.trace_scale(), law, runs, rate)
    return not end.is_predictable and not pooled_rmse([end], "corrected") < LOST


def _restarted(problem: Problem, analysis: Analysis) -> list[Predictions]:
    if follows_segments(problem):
        # The fit of a state takes as many calls of a program as the search for the law.
        problem.budget.leave_out("forecasts from a state fitted just before the held-out time")
        return []
    free, heldout = analysis.trajectories, problem.split.heldout
    corrected = free.states["corrected"][: len(problem.split.fit.times)]
    found = analysis.discovery
    forecasts = restart(problem, found.best, found.uncorrected, corrected, free.growth_rate)
    return [
        _over_heldout_time(problem, analysis, heldout.samples(part), runs)
        for part, runs in forecasts
    ]


def _over_heldout_time(
    problem: Problem, analysis: Analysis, heldout: Recording, runs: Mapping[str, Tensor]
) -> Predictions:
    scale = _fitted_scale(problem, [problem])
    law, rate = analysis.discovery.best, analysis.trajectories.growth_rate
    return predict(problem, heldout, scale, law, runs, rate)


def _fitted_scale(problem: Problem, fitted: Sequence[Problem]) -> Array:
    """Return the std of the held-out sensors' traces in the fit window, ``(sensor,)``."""
    names = problem.split.heldout.names
    return np.array([_fitted_std(name, fitted) for name in names])


def _fitted_std(name: str, fitted: Sequence[Problem]) -> float:
    """Return the std of a trace in the fit window, as rms over several episodes."""
    stds = []
    for problem in fitted:
        split = problem.split
        part = split.fit if name in split.fit.names else split.validation
        stds.append(float(part.select([name]).trace_scale()[0]))
    return stds[0] if len(stds) == 1 else math.sqrt(sum(std**2 for std in stds) / len(stds))
