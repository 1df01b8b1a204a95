"""Write the findings of an analysis and the files beside them, and freeze them."""

from __future__ import annotations

from pathlib import Path

import xarray as xr

from dashred.core.files.atomic import write_netcdf_atomic
from dashred.core.findings.findings import freeze, write_json_atomic
from dashred.core.findings.schema import Findings
from dashred.pipeline.analysis import Analysis
from dashred.pipeline.outputs.corrected_config import NAME as CORRECTED
from dashred.pipeline.outputs.corrected_config import write_corrected
from dashred.pipeline.outputs.corrected_fmu import NAME as FMU
from dashred.pipeline.outputs.corrected_fmu import write_corrected_fmu
from dashred.pipeline.outputs.estimator_file import NAME as ESTIMATOR
from dashred.pipeline.outputs.estimator_file import whole_recording, write_estimator
from dashred.pipeline.outputs.field_files import episodes_dataset
from dashred.pipeline.problem import Problem
from dashred.pipeline.verification.sensor_noise import noise_of_sensors
from dashred.reporting.text.support import is_confirmed

# Standard deviation of the observer's estimate.
SPREAD = "observer_spread.nc"
# The remark in the corrected configuration of an explanation that is not confirmed.
UNCONFIRMED = "This explanation is suggested, but not confirmed."


def write_findings(problem: Problem, analysis: Analysis, findings: Findings, output: Path) -> None:
    """Write the fields, the corrected configuration, the estimator and the findings; freeze all."""
    write_netcdf_atomic(output / "estimates.nc", estimates_dataset(problem, analysis))
    write_netcdf_atomic(output / "forecast.nc", forecast_dataset(problem, analysis))
    others = ["estimates.nc", "forecast.nc"]
    if analysis.observed is not None:
        write_netcdf_atomic(output / SPREAD, observer_spread(problem, analysis))
        others.append(SPREAD)
    if findings["corrected"] is not None:
        law = analysis.discovery.best
        sha256 = problem.recording_sha256
        remark = "" if is_confirmed(findings) else UNCONFIRMED
        hidden = problem.hidden
        told = write_corrected_fmu(output / FMU, problem, law, analysis.trajectories, remark)
        if (output / FMU).is_file():
            others.append(FMU)
        remark = " ".join(filter(None, (remark, told)))
        path = output / CORRECTED
        dt = analysis.trajectories.shortest_dt
        write_corrected(path, problem.config, problem.system, law, sha256, remark, hidden, dt)
        others.append(CORRECTED)
        network, recording = analysis.corrected_network.shred, whole_recording(problem.split)
        write_estimator(
            output / ESTIMATOR,
            recording,
            [axis.name for axis in problem.system.axes],
            problem.split.roles,
            noise_of_sensors(problem, analysis, recording.names),
            network,
            problem.config.shred.lags,
        )
        others.append(ESTIMATOR)
    freeze_findings(output, findings, others)


def estimates_dataset(problem: Problem, analysis: Analysis) -> xr.Dataset:
    """Return the fields by method over the fit window of every episode."""
    fields = []
    for episode, part in analysis.episodes(problem):
        count = len(episode.split.fit.times)
        fields.append((episode, episode.times[:count], part.estimates(count)))
    return episodes_dataset(fields)


def observer_spread(problem: Problem, analysis: Analysis) -> xr.Dataset:
    """Return the standard deviation of the observer's estimate, of every observed episode."""
    fields = []
    for episode, part in analysis.episodes(problem):
        if part.observed is not None:
            times = episode.times[: len(episode.split.fit.times)]
            fields.append((episode, times, {"observer": part.observed[1]}))
    return episodes_dataset(fields)


def forecast_dataset(problem: Problem, analysis: Analysis) -> xr.Dataset:
    """Return the free runs beyond the recording, of every episode."""
    free = analysis.trajectories
    runs = zip((*problem.episodes, *problem.whole), (free, *free.others, *free.whole), strict=True)
    forecasts = []
    for episode, run in runs:
        ahead = slice(run.recorded, len(run.times))
        forecasts.append((episode, run.times[ahead], run.over(ahead)))
    return episodes_dataset(forecasts)


def freeze_findings(output: Path, findings: Findings, others: list[str]) -> None:
    """Write ``findings.json`` and freeze its hash before any seal can be opened."""
    write_json_atomic(output / "findings.json", findings)
    freeze(output, others)
