"""Figures that compare the estimates with the truth, for the scorer."""

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

# More methods would be too many for one figure.
PANEL_METHODS = ("simulation", "simulation_refit", "shred", SHRED_UNCHANGED, "dashred", "corrected")


def draw_truth(
    output: Path,
    estimates: xr.Dataset,
    true: np.ndarray,
    fields: Sequence[str],
    errors: Mapping[str, np.ndarray],
    tracked: tuple[str, float] | None,
    units: Mapping[str, str],
) -> list[Path]:
    """Draw the errors over time, the fields, and the tracked front if any; return the files.

    Args:
        output: folder of the figures.
        estimates: fields by method.
        true: the true states, ``(time, field, *grid)``.
        fields: names of the fields.
        errors: RMSE at each time, by method.
        tracked: the field whose front is tracked, and the length of the periodic axis.
        units: units by name; that of time is `t`.
    """
    gallery = Gallery(output)
    times = estimates["time"].values
    label = "field RMSE / standard deviation"
    clock = time_label(units)
    drawn_methods = methods_to_draw(estimates)
    curves = {name: errors[method] for name, method in drawn_methods.items() if method in errors}
    figure = rmse_against_time(times, curves, float(times[-1]), label, clock)
    gallery.save(figure, "rmse_against_time.png")
    axes = [str(dim) for dim in estimates[fields[0]].dims if dim not in ("method", "time")]
    panels = {
        field: {
            "truth": true[:, i],
            **{
                m: estimates[field].sel({"method": drawn_methods[m]}).values
                for m in PANEL_METHODS
                if m in curves
            },
        }
        for i, field in enumerate(fields)
    }
    places = {name: estimates[name].values for name in axes}
    if not axes:
        gallery.save(state_traces(times, panels, units), "state_truth.png")
    elif len(axes) == 1:
        name = label_with_unit(axes[0], units.get(axes[0]))
        figure = space_time_panels(times, name, places[axes[0]], panels, {}, clock=clock)
        gallery.save(figure, "space_time_truth.png")
    else:
        figure = snapshot_panels(times, places, panels, {}, units)
        gallery.save(figure, "snapshots_truth.png")
    if tracked is not None:
        field, length = tracked
        figure = front_figure(times, panels[field], axes[0], length, units)
        gallery.save(figure, "front_truth.png")
    return gallery.drawn


def methods_to_draw(estimates: xr.Dataset) -> dict[str, str]:
    """Return the methods to draw by name; SHRED and DA-SHRED are one if their fields are equal.

    They are equal if no validation sensor confirms the latent transform, which is then off.

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
