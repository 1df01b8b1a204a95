"""Verify on what was held out, and freeze the findings."""

from __future__ import annotations

import json
import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import torch
import xarray as xr
from torch import Tensor

from dashred.config import config_sha256, frozen_input
from dashred.discovery.explanation import alternatives, explain, smaller
from dashred.discovery.location import locate
from dashred.discovery.regression import SparseFit
from dashred.discovery.verdict import unexplained, verdict
from dashred.findings import (
    EpisodeSplit,
    Findings,
    Fit,
    Input,
    Latent,
    LatentSindy,
    PathStep,
    Proposal,
    Splits,
    freeze,
    misfit,
    new_findings,
    versions,
    write_json_atomic,
)
from dashred.physics.resolution import Resolution
from dashred.physics.system import System
from dashred.stages.analysis import Analysis
from dashred.stages.corrected import NAME as CORRECTED
from dashred.stages.corrected import write_corrected
from dashred.stages.energy import energy_lost
from dashred.stages.problem import Problem
from dashred.stages.restart import restart
from dashred.stages.structure import structure_changed
from dashred.whole_files import write_netcdf_atomic

# What the findings call the methods.
MISFITS = {
    "simulation": "simulation",
    "simulation_same_start": "before",
    "simulation_refit": "before_refit",
    "shred": "shred",
    "dashred": "dashred",
    "corrected": "after",
}


def verify(problem: Problem, analysis: Analysis) -> Findings:
    """Compare every method with the test sensors and the held-out time, for the first time."""
    discovered = analysis.discovered
    kind, causes = verdict(discovered, problem.fault_in_words)
    units = problem.system.units
    episodes = analysis.episodes(problem)
    names = problem.split.fit.names
    fit = Fit(
        # Of several episodes the same in each.
        noise_std=problem.noise | dict(zip(names, discovered.noise.std.tolist(), strict=False)),
        noise_correlation=float(discovered.noise.correlation.max()),
        chi2=discovered.best.chi2,
        unexplained=unexplained(
            problem.noise_of(names).repeat(len(problem.episodes)), discovered.noise
        ),
        test_sensors=misfit(**_pooled(_test_errors, episodes)),
        heldout_time=misfit(**_pooled(_heldout_errors, episodes)),
        heldout_restarted=misfit(**_pooled(_restarted_errors, episodes)),
    )
    if problem.whole:
        fit["heldout_episode"] = misfit(**_whole_errors(problem, analysis))
    proposed = {n: proposals(problem, f) for n, f in analysis.found.proposals.items()}
    latent = Latent(alg1=proposed["alg1"], alg2=proposed["alg2"])
    if kind == "not-converged":
        return new_findings(
            source_of(problem), fit=fit, latent=latent, verdict=kind, causes=causes, units=units
        )
    count = len(problem.split.fit.times)
    return new_findings(
        source_of(problem),
        fit=fit,
        latent=latent,
        verdict=kind,
        causes=causes,
        where=locate(
            problem.system,
            discovered,
            analysis.free.states["corrected"][:count],
            problem.times[:count],
            names,
        ),
        terms=explain(problem.system, discovered),
        alternatives=alternatives(discovered, problem.system.units),
        smaller=smaller(discovered),
        energy=energy_lost(
            problem.system,
            replace(discovered.best, start=problem.starts(discovered.best.start)[0]),
            problem.times[:count],
            problem.rng("energy"),
        ),
        structure=structure_changed(
            problem.system, discovered.best, analysis.free.states["corrected"][:count]
        ),
        corrected=CORRECTED,
        units=units,
    )


def refuse_unresolved(problem: Problem, resolution: Resolution) -> Findings:
    """Return the findings of a simulator whose numerical error would pass for physics."""
    points = {axis.name: axis.points for axis in problem.system.axes}
    enough = None
    if resolution.enough is not None:
        enough = {name: count * resolution.enough for name, count in points.items()}
    advice = "even doubling it twice would not do"
    if enough:
        listed = " and ".join(f"{count} points along {name}" for name, count in enough.items())
        advice = " with ".join(filter(None, [listed, "half the time step"])) + " would do"
    says = (
        f"doubling the resolution moves a sensor trace by {resolution.error:.1%} of its standard "
        f"deviation, above the limit of {resolution.limit:.1%}; {advice}"
    )
    cause = {
        "kind": "unresolved-numerics",
        "says": says,
        "probability": 1.0,
        "doubling_error": resolution.error,
        "limit": resolution.limit,
        "points": points,
        "enough": enough,
    }
    return new_findings(
        source_of(problem),
        verdict="unresolved-numerics",
        causes=[cause],
        units=problem.system.units,
    )


def write_estimates(
    path: Path,
    system: System,
    times: Tensor,
    fields: dict[str, Tensor],
    episodes: Sequence[str] = (),
) -> None:
    """Write fields by method, dims ``(method, time, *axes)``, one variable a field.

    Args:
        path: the file.
        system: names and grid.
        times: ``(time,)``.
        fields: by method, ``(time, field, *grid)``.
        episodes: that of every sample, where there are several.
    """
    axes = [axis.name for axis in system.axes]
    stacked = system.grid.own(torch.stack(list(fields.values()))).numpy()
    data = {
        name: (("method", "time", *axes), stacked[:, :, i].astype(np.float64))
        for i, name in enumerate(system.fields)
    }
    coordinates: dict[str, Any] = {"method": list(fields), "time": times.numpy()}
    if len(episodes):
        coordinates["episode"] = ("time", list(episodes))
    coordinates |= {name: x.numpy() for name, x in system.grid.own_coordinates.items()}
    write_netcdf_atomic(path, xr.Dataset(data, coordinates))


def write_findings(problem: Problem, analysis: Analysis, findings: Findings, output: Path) -> None:
    """Write the fields, the forecast, the corrected configuration and the findings; freeze all."""
    system, free = problem.system, analysis.free
    fields = []
    for episode, mine in analysis.episodes(problem):
        count = len(episode.split.fit.times)
        fields.append((episode, episode.times[:count], mine.estimates(count)))
    _write_all(output / "estimates.nc", fields)
    runs = zip((*problem.episodes, *problem.whole), (free, *free.others, *free.whole), strict=True)
    beyond = []
    for episode, run in runs:
        ahead = slice(run.recorded, len(run.times))
        beyond.append((episode, run.times[ahead], run.over(ahead)))
    _write_all(output / "forecast.nc", beyond)
    others = ["estimates.nc", "forecast.nc"]
    if findings["corrected"] is not None:
        law = analysis.discovered.best
        sha256 = problem.recording_sha256
        write_corrected(output / CORRECTED, problem.config, system, law, sha256)
        others.append(CORRECTED)
    freeze_findings(output, findings, others)


def _write_all(path: Path, parts: Sequence[tuple[Problem, Tensor, dict[str, Tensor]]]) -> None:
    """Write what methods make of every episode, one after another."""
    system = parts[0][0].system
    if len(parts) == 1:
        [(_, times, fields)] = parts
        write_estimates(path, system, times, fields)
        return
    methods = [name for name in parts[0][2] if all(name in fields for *_, fields in parts)]
    together = {name: torch.cat([fields[name] for *_, fields in parts]) for name in methods}
    labels = [episode.name for episode, times, _ in parts for _ in times]
    write_estimates(path, system, torch.cat([t for _, t, _ in parts]), together, labels)


def freeze_findings(output: Path, findings: Findings, others: list[str]) -> None:
    """Write ``findings.json`` and fix its hash, before any seal can be opened."""
    write_json_atomic(output / "findings.json", findings)
    freeze(output, others)


def source_of(problem: Problem) -> Input:
    """Return everything that determines the findings."""
    split, config = problem.split, problem.config
    sizes = {
        equation: sum(term.equation == equation for term in problem.library)
        for equation in problem.system.fields
    }
    splits = Splits(
        inputs=list(split.inputs),
        extra=list(split.extra),
        validate=list(split.validate),
        test=list(split.test),
        time_end=split.time_end,
        note=f"{split.note} Clock: {problem.clock}",
    )
    if problem.others:
        splits["episodes"] = _episodes(problem)
    return Input(
        config=json.loads(json.dumps(frozen_input(config))),
        config_sha256=config_sha256(config),
        recording_sha256=problem.recording_sha256,
        seed=config.seed,
        versions=versions(),
        library_size=sizes,
        splits=splits,
    )


def _episodes(problem: Problem) -> list[EpisodeSplit]:
    """Return what was fitted of every episode, and what was held out."""
    every = [*((p, False) for p in problem.episodes), *((p, True) for p in problem.whole)]
    return [
        EpisodeSplit(
            name=episode.name,
            begin=float(episode.times[0]),
            end=float(episode.times[-1]),
            time_end=episode.split.time_end,
            held_out_whole=whole,
        )
        for episode, whole in every
    ]


# By method: the RMSE, and over how many values it is.
Errors = dict[str, tuple[float, int]]


def _pooled(
    errors: Callable[[Problem, Analysis], Errors], episodes: Sequence[tuple[Problem, Analysis]]
) -> dict[str, float]:
    """Return the RMSE of each method over all samples of all episodes."""
    found = [errors(problem, analysis) for problem, analysis in episodes]
    if len(found) == 1:
        return {name: rmse for name, (rmse, _) in found[0].items()}
    pooled = {}
    for name in found[0]:
        seen = [(rmse, count) for rmse, count in (each[name] for each in found) if count]
        total = sum(count for _, count in seen)
        squares = sum(rmse**2 * count for rmse, count in seen)
        pooled[name] = math.sqrt(squares / total) if total else math.nan
    return pooled


def _test_errors(problem: Problem, analysis: Analysis) -> Errors:
    split = problem.split
    tested = split.tested.between(float(problem.times[0]), split.time_end)
    if not tested.sensors:
        return {}
    operator, scale = problem.operator(tested), tested.trace_unit()
    count = int((~np.isnan(tested.values)).sum())
    return {
        MISFITS[name]: (relative_rmse(operator(states).numpy(), tested.values, scale), count)
        for name, states in analysis.estimates(len(tested.times)).items()
        if name in MISFITS
    }


def _heldout_errors(problem: Problem, analysis: Analysis) -> Errors:
    total = len(problem.times)
    begin = total - len(problem.split.heldout.times)
    ends = {"simulation": analysis.nominal.states, **analysis.free.states}
    runs = {MISFITS[name]: states[begin:total] for name, states in ends.items()}
    return _on_heldout(problem, runs, [problem])


def _restarted_errors(problem: Problem, analysis: Analysis) -> Errors:
    corrected = analysis.free.states["corrected"][: len(problem.split.fit.times)]
    restarted = restart(problem, analysis.discovered.best, corrected)
    return _on_heldout(problem, restarted, [problem])


def _whole_errors(problem: Problem, analysis: Analysis) -> dict[str, float]:
    """Return the RMSE of free runs over what follows the beginning of the whole episode."""
    [whole], [simulated], [free] = problem.whole, analysis.nominal.whole, analysis.free.whole
    ends = slice(len(whole.split.fit.times), len(whole.times))
    states = {"simulation": simulated, **free.states}
    runs = {MISFITS[name]: path[ends] for name, path in states.items()}
    errors = _on_heldout(whole, runs, problem.episodes)
    return {name: rmse for name, (rmse, _) in errors.items()}


def _on_heldout(problem: Problem, runs: Mapping[str, Tensor], fitted: Sequence[Problem]) -> Errors:
    """Return the RMSE of states over the held-out time, in units of each trace's fitted std."""
    heldout = problem.split.heldout
    scale = np.array([_fitted_std(name, fitted) for name in heldout.names])
    operator = problem.operator(heldout)
    count = int((~np.isnan(heldout.values)).sum())
    return {
        name: (relative_rmse(operator(states).numpy(), heldout.values, scale), count)
        for name, states in runs.items()
    }


def _fitted_std(name: str, fitted: Sequence[Problem]) -> float:
    """Return the std of a sensor's trace while it was fitted, of several episodes its rms."""
    stds = []
    for problem in fitted:
        split = problem.split
        part = split.fit if name in split.fit.names else split.validation
        stds.append(float(part.select([name]).trace_unit()[0]))
    return stds[0] if len(stds) == 1 else math.sqrt(sum(std**2 for std in stds) / len(stds))


def relative_rmse(read: np.ndarray, recorded: np.ndarray, scale: np.ndarray) -> float:
    """RMSE over all sensors, each in units of its trace's std; not finite if a run blows up.

    Missing samples are left out, and they alone: what a lost run would read is not missing.
    """
    seen = ~np.isnan(recorded)
    error = ((read - recorded) / scale)[seen]
    return float(np.sqrt(np.mean(error**2))) if seen.any() else math.nan


def proposals(problem: Problem, fit: SparseFit) -> LatentSindy:
    """Return what one of the two algorithms proposes, the likest term first."""
    proposed = [
        Proposal(
            equation=problem.library[j].equation,
            term=str(problem.library[j]),
            coefficient=float(fit.coefficients[j]),
            inclusion=float(fit.inclusion[j]),
            rank=rank,
        )
        for rank, j in enumerate(fit.ranking, start=1)
    ]
    path = [PathStep(terms=terms, rmse=rmse) for terms, rmse in fit.path]
    return LatentSindy(proposals=proposed, rmse_path=path)
