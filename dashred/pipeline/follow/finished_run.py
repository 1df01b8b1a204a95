"""Read what a finished run has learnt: the corrected simulator and SHRED, sensors and readings."""

from __future__ import annotations

import json
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
import torch
import xarray as xr
from numpy.typing import NDArray

from dashred.config import build_config, read_file
from dashred.config.source import Source
from dashred.core.errors import InputError
from dashred.core.files.damaged_files import reading_errors
from dashred.core.files.external_links import check_hdf5
from dashred.core.findings.findings import check_freeze
from dashred.data.io.read_netcdf import episodes_of_dataset
from dashred.data.sensors import Sensor
from dashred.models.shred import SHRED
from dashred.physics.backends.input_signals import InputSignals
from dashred.physics.system import System
from dashred.pipeline.outputs.corrected_config import NAME as CORRECTED
from dashred.pipeline.outputs.estimator_file import CHANGED, ROLE, WEIGHT
from dashred.pipeline.outputs.estimator_file import NAME as ESTIMATOR

Array = NDArray[np.float64]

# Largest number of values of the climate.
MOST_VALUES = 4_000_000
INPUT = "input"
AGAIN = "run the analysis again with this version of dashred"


@dataclass(frozen=True)
class FinishedRun:
    """What ``dashred follow`` needs of a run.

    Attributes:
        folder: of the run.
        system: the corrected simulator, without its inputs.
        signals: samples of its inputs in the recording, by column.
        sensors: of the recording, with the σ of their noise.
        faulty: names of sensors that the run found to be faulty.
        times: of the recording, ``(time,)``.
        values: its readings, ``(time, sensor)``.
        step: of its clock.
        climate: states of the corrected simulator, ``(state, field*point)``.
        shred: the corrected SHRED.
        network_sensors: indices of the sensors that it reads.
        lags: number of samples before the present one in a window.
    """

    folder: Path
    system: System
    signals: InputSignals
    sensors: tuple[Sensor, ...]
    faulty: tuple[str, ...]
    times: Array
    values: Array
    step: float
    climate: Array
    shred: SHRED
    network_sensors: tuple[int, ...]
    lags: int

    @property
    def names(self) -> tuple[str, ...]:
        """Names of the sensors."""
        return tuple(sensor.name for sensor in self.sensors)

    @property
    def noise(self) -> Array:
        """σ of each sensor, ``(sensor,)``."""
        return np.array([sensor.std for sensor in self.sensors], dtype=np.float64)


def read_run(folder: Path, trust: str | None = None) -> FinishedRun:
    """Read the folder of a finished run.

    Args:
        folder: output folder of ``dashred train``.
        trust: name of the program that is the simulator, whose code may run.

    Raises:
        InputError: it is not the folder of a finished run, its files were changed, it has no
            corrected simulator, or its system cannot be followed.
    """
    if not folder.is_dir():
        raise InputError("there is no such folder", where=str(folder), hint="run=FOLDER of a run")
    check_freeze(folder)
    findings = json.loads((folder / "findings.json").read_text(encoding="utf-8"))
    if findings["corrected"] is None:
        what = f"this run has no corrected simulator: its verdict is {findings['verdict']}"
        raise InputError(what, where=str(folder), hint="choose a run that has corrected.yaml")
    path = folder / ESTIMATOR
    if not path.is_file():
        raise InputError(f"this run has no {ESTIMATOR}", where=str(folder), hint=AGAIN)
    system = _corrected(folder / CORRECTED, trust)
    dataset = _dataset(path)
    weights = {
        str(name).removeprefix(WEIGHT): torch.from_numpy(dataset[name].to_numpy())
        for name in dataset.data_vars
        if str(name).startswith(WEIGHT)
    }
    rest = dataset.drop_vars([f"{WEIGHT}{name}" for name in weights])
    _check_plain(rest, path)
    recording = episodes_of_dataset(rest, str(path), system).single(str(path))
    roles = [str(role) for role in rest[ROLE].to_numpy()]
    steps = np.diff(recording.times)
    return FinishedRun(
        folder=folder,
        system=system,
        signals=recording.inputs,
        sensors=recording.sensors,
        faulty=_faulty(findings),
        times=recording.times,
        values=recording.values,
        step=float(f"{np.median(steps):.12g}"),
        climate=_climate(folder, system),
        shred=SHRED.from_weights(weights, tuple(system.grid.shape)).requires_grad_(False),
        network_sensors=tuple(index for index, role in enumerate(roles) if role == INPUT),
        lags=int(dataset.attrs["lags"]),
    )


def _corrected(path: Path, trust: str | None) -> System:
    no_overrides = Source({}, {"": "overrides"})
    written = read_file(path, label=str(path))
    config = build_config(written, no_overrides, name=path.stem, source=path, trust=trust)
    system = System(config.system, config.where)
    own = [name for name in system.inputs if name not in system.measured_inputs]
    if own:
        raise InputError(
            f"the system has inputs that are not measured ({', '.join(own)})",
            where=str(path),
            hint="follow needs one corrected simulator for all times: analyse one episode alone",
        )
    return system if np.isnan(system.dt) else system.with_fixed_steps()


def _check_plain(dataset: xr.Dataset, path: Path) -> None:
    changed = dataset["name"].to_numpy()[dataset[CHANGED].to_numpy() != 0]
    if len(changed):
        raise InputError(
            f"the sensor {str(changed[0])!r} was calibrated, or reads an input or the time",
            where=str(path),
            hint="follow reads plain readings of the state; only runs with these can be followed",
        )


def _faulty(findings: dict[str, object]) -> tuple[str, ...]:
    """Return the names of the sensors that the findings call faulty."""
    causes = findings["causes"]
    assert isinstance(causes, list)
    named = [
        str(cause["sensor"])
        for cause in causes
        if cause["kind"] == "sensor-fault" and (cause["probability"] or 0.0) > 0.5
    ]
    return tuple(dict.fromkeys(named))


def _climate(folder: Path, system: System) -> Array:
    """Return the states of the corrected simulator in the recording and after it."""
    states = []
    for name in ("estimates.nc", "forecast.nc"):
        fields = _dataset(folder / name).sel({"method": "corrected"})
        own = torch.stack([torch.tensor(fields[each].to_numpy()) for each in system.fields], dim=1)
        states.append(own.double().flatten(1))
    found = torch.cat(states).numpy()
    found = found[np.isfinite(found).all(axis=1)]
    most = max(2, MOST_VALUES // found.shape[1])
    if len(found) < 2:
        what = "the corrected simulator blows up from its fitted start"
        raise InputError(what, where=str(folder), hint="choose another run")
    return found[:: -(-len(found) // most)].copy()


def _dataset(path: Path) -> xr.Dataset:
    with reading_errors("NetCDF-4 file", str(path)):
        check_hdf5(str(path))
        with xr.open_dataset(path, engine="h5netcdf", decode_times=False) as dataset:
            return dataset.load()


def without_sensors(run: FinishedRun, names: tuple[str, ...]) -> FinishedRun:
    """Return the run with the readings of some sensors left out of its recording."""
    columns = [index for index, name in enumerate(run.names) if name in names]
    values = run.values.copy()
    values[:, columns] = np.nan
    return replace(run, values=values)
