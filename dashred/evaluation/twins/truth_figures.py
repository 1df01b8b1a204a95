"""Figures that hold the estimates against the truth: a scorer's, who alone has it."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path

import numpy as np
import xarray as xr

from dashred.core.findings.methods import SHRED_UNCHANGED
from dashred.core.units import label_with_unit, time_label
from dashred.reporting.figures.gallery import Gallery
from dashred.reporting.figures.save import (
    front_figure,
    rmse_against_time,
    snapshot_panels,
    space_time_panels,
    state_traces,
)

# More than these could not be told apart on one page.
PANELS = ("simulation", "simulation_refit", "shred", SHRED_UNCHANGED, "dashred", "corrected")


def draw_truth(
    output: Path,
    estimates: xr.Dataset,
    real: np.ndarray,
    fields: Sequence[str],
    errors: Mapping[str, np.ndarray],
    followed: tuple[str, float] | None,
    units: Mapping[str, str],
) -> list[Path]:
    """Draw errors against time, the fields, and the front where one is followed; returns the files.

    Args:
        output: the folder.
        estimates: fields by method.
        real: the true states, ``(time, field, *grid)``.
        fields: their names.
        errors: RMSE at each time by method.
        followed: the field with a front, and the length of the ring that it runs around.
        units: by name, that of time as `t`.
    """
    gallery = Gallery(output)
    times = estimates["time"].values
    label = "field RMSE / standard deviation"
    clock = time_label(units)
    shown = joined(estimates)
    curves = {name: errors[method] for name, method in shown.items() if method in errors}
    figure = rmse_against_time(times, curves, float(times[-1]), label, clock)
    gallery.save(figure, "rmse_against_time.png")
    axes = [str(dim) for dim in estimates[fields[0]].dims if dim not in ("method", "time")]
    panels = {
        field: {
            "truth": real[:, i],
            **{m: estimates[field].sel({"method": shown[m]}).values for m in PANELS if m in curves},
        }
        for i, field in enumerate(fields)
    }
    places = {name: estimates[name].values for name in axes}
    if not axes:
        gallery.save(state_traces(times, panels, {}, units), "state_truth.png")
    elif len(axes) == 1:
        name = label_with_unit(axes[0], units.get(axes[0]))
        figure = space_time_panels(times, name, places[axes[0]], panels, {}, clock=clock)
        gallery.save(figure, "space_time_truth.png")
    else:
        figure = snapshot_panels(times, places, panels, {}, units)
        gallery.save(figure, "snapshots_truth.png")
    if followed is not None:
        field, length = followed
        figure = front_figure(times, panels[field], axes[0], length, units)
        gallery.save(figure, "front_truth.png")
    return gallery.drawn


def joined(estimates: xr.Dataset) -> dict[str, str]:
    """Return the methods to draw by name: SHRED and DA-SHRED as one where their fields are equal.

    The latent transform stays off where no validation sensor confirms it.

    Args:
        estimates: fields by method.
    """
    methods = estimates["method"].values.tolist()
    if not {"shred", "dashred"} <= set(methods):
        return {method: method for method in methods}
    before, after = (estimates.sel({"method": m}, drop=True) for m in ("shred", "dashred"))
    if not before.equals(after):
        return {method: method for method in methods}
    kept = (method for method in methods if method != "dashred")
    return {SHRED_UNCHANGED if method == "shred" else method: method for method in kept}
