"""Load a result that the Python API or the command line has saved."""

from __future__ import annotations

import json
import os
import shutil
from collections.abc import Mapping
from functools import partial
from pathlib import Path
from typing import Any

import torch
import xarray as xr
from matplotlib.figure import Figure
from matplotlib.image import imread

from dashred.config import build_config, read_file
from dashred.config.source import Source
from dashred.core.errors import InputError
from dashred.core.files.damaged_files import reading_errors
from dashred.core.files.external_links import check_hdf5
from dashred.core.files.user_path import user_path
from dashred.core.findings.findings import check_freeze
from dashred.physics.system import System
from dashred.pipeline.api.result import Result
from dashred.pipeline.api.simulator import Simulator
from dashred.pipeline.outputs.corrected_config import NAME as CORRECTED
from dashred.pipeline.run.output_dir import check_ours, clear_output, make_output, results_in
from dashred.reporting.figures.figure_names import is_report_figure

DPI = 100


def load(folder: str | os.PathLike[str]) -> Result:
    """Load a saved result.

    Args:
        folder: folder that :meth:`Result.save` or ``dashred train output=FOLDER`` has written.

    Returns:
        The result that the files contain. Its figures are the saved images.

    Raises:
        InputError: the folder contains no result, or its files were changed after the run.
    """
    place = user_path(os.fspath(folder), "load")
    if not place.is_dir():
        raise InputError("there is no such folder", where=str(place))
    check_freeze(place)
    findings = json.loads((place / "findings.json").read_text(encoding="utf-8"))
    estimates = _dataset(place / "estimates.nc")
    images = sorted(path for path in place.iterdir() if is_report_figure(path))
    return Result(
        findings=findings,
        estimates=estimates,
        forecast=_dataset(place / "forecast.nc"),
        build_corrected=partial(_corrected_simulator, place / CORRECTED, findings, estimates),
        figures={path.name: partial(_image_figure, path) for path in images},
        main_effects=[],
        write=partial(_copy, place),
    )


def _dataset(path: Path) -> xr.Dataset | None:
    if not path.is_file():
        return None
    with reading_errors("NetCDF-4 file", str(path)):
        check_hdf5(str(path))
        with xr.open_dataset(path, engine="h5netcdf", decode_times=False) as dataset:
            return dataset.load()


def _corrected_simulator(
    path: Path, findings: Mapping[str, Any], estimates: xr.Dataset | None
) -> Simulator | None:
    """Return the corrected simulator, with the fitted start from the estimates."""
    if findings["corrected"] is None or estimates is None:
        return None
    no_overrides = Source({}, {"": "overrides"})
    config = build_config(
        read_file(path, label=str(path)), no_overrides, name=path.stem, source=path
    )
    system = System(config.system, config.where)
    if system.inputs:
        raise InputError(
            "the corrected system has measured inputs, which the folder does not contain",
            where=str(path),
            hint=f"use dashred.Problem.from_yaml({str(path)!r}, recording=...)",
        )
    fields = estimates.sel({"method": "corrected"})
    if "episode" in fields.coords:
        fields = fields.isel(time=(fields["episode"] == fields["episode"][0]).to_numpy())
    first = fields.isel(time=0)
    start = torch.stack([torch.tensor(first[name].to_numpy()) for name in system.fields])
    clock = torch.tensor(fields["time"].to_numpy())
    return Simulator(system, lambda: system.grid.ring(start), clock)


def _image_figure(path: Path) -> Figure:
    """Return a figure that shows an image file at its own size."""
    image = imread(path)
    height, width = image.shape[:2]
    figure = Figure(figsize=(width / DPI, height / DPI), dpi=DPI)
    axes = figure.add_axes((0, 0, 1, 1))
    axes.imshow(image, interpolation="none")
    axes.set_axis_off()
    return figure


def _copy(source: Path, folder: Path) -> None:
    """Copy the files of a result to another folder."""
    output = make_output(str(folder))
    if output.samefile(source):
        return
    files = [*results_in(source), *(path for path in source.iterdir() if is_report_figure(path))]
    check_ours(output, (), str(folder))
    clear_output(output)
    for path in files:
        shutil.copyfile(path, output / path.name)
