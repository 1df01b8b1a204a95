"""Where the law acts: in space and time, at each sensor, and in which equation."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from jaxtyping import Float
from matplotlib.axes import Axes
from matplotlib.colors import LinearSegmentedColormap
from matplotlib.figure import Figure
from matplotlib.ticker import FuncFormatter, LogLocator, NullFormatter

from dashred.core.formatting import percent
from dashred.core.units import NO_UNITS, label_with_unit, time_label
from dashred.reporting.figures.fields.cells import frame_points, image_extent
from dashred.reporting.figures.fields.space_time import mark_sensors
from dashred.reporting.figures.style import (
    BLUE,
    GREEN,
    GREY,
    LIGHT,
    ORANGE,
    VERMILION,
    new_figure,
    style,
)
from dashred.reporting.text.regions import extent

MAX_SENSORS = 18
WITHOUT, WITH = "without the law", "with the law"
# White where the law is zero.
INTENSITY = LinearSegmentedColormap.from_list(
    "intensity", ["#ffffff", "#f9ddb9", "#efaa62", VERMILION, "#7a2a00", "#2b0d00"]
)


@dataclass(frozen=True)
class LawMap:
    """Tendency of the law by position and time, for a system with one axis.

    Attributes:
        axis: name of the axis.
        x: positions, ``(x,)``.
        times: times, ``(time,)``.
        size: |law| in units of the RMS of the simulator's tendency, ``(time, x)``.
        sensors: position of each sensor.
    """

    axis: str
    x: Float[np.ndarray, " x"]
    times: Float[np.ndarray, " time"]
    size: Float[np.ndarray, "time x"]
    sensors: Mapping[str, float]


def where_figure(
    where: Mapping[str, Any], law_map: LawMap | None = None, units: Mapping[str, str] = NO_UNITS
) -> Figure:
    """Plot ``findings["where"]``, with a map if the system has one axis."""
    sensors = _choose(where["sensors"], law_map)
    shares = where["equation"] if len(where["equation"]) > 1 else {}
    rows = max(len(sensors), 4)
    height = max(3.4 if law_map is None else 5.6, 1.4 + 0.2 * rows + (0.7 if shares else 0))
    with style():
        figure = new_figure(9.6, height)
        left, right = figure.subfigures(1, 2, squeeze=False, width_ratios=(5.6, 4.0), wspace=0.05)[
            0
        ]
        if law_map is None:
            profile = left.subplots()
        else:
            panels = left.subplots(2, 1, sharex=True, height_ratios=(3, 2))
            _draw_map(left, panels[0], law_map, where, units)
            profile = panels[1]
        _draw_profile(profile, where["profile"], time_label(units))
        if shares:
            top, below = right.subplots(2, 1, height_ratios=(0.55, rows * 0.2 + 1))
            _draw_shares(top, shares)
        else:
            below = right.subplots()
        _draw_sensors(below, sensors, len(where["sensors"]))
        figure.suptitle("Where the law acts", x=0.01, ha="left")
        # The legend is beside the title, where it covers no curve.
        handles, labels = profile.get_legend_handles_labels()
        figure.legend(handles, labels, loc="upper right", ncols=2)
    return figure


def _draw_map(
    figure: Any, axes: Axes, law: LawMap, where: Mapping[str, Any], units: Mapping[str, str]
) -> None:
    axes.grid(False)
    image = axes.imshow(
        law.size.T,
        origin="lower",
        aspect="auto",
        extent=image_extent(law.times, law.x),
        cmap=INTENSITY,
        vmin=0,
        vmax=float(np.nanpercentile(law.size, 99.8)) or 1.0,
        interpolation="nearest",
    )
    frame_points(axes, law.times, law.x)
    mark_sensors(axes, list(law.sensors.values()))
    label = "law / RMS of the\nsimulation's tendency"
    figure.colorbar(image, ax=axes, label=label, pad=0.015, aspect=16)
    axes.set_ylabel(label_with_unit(law.axis, units.get(law.axis)))
    axes.set_title(f"it acts {extent(where, units)}", fontsize=9)


def _draw_profile(axes: Axes, profile: Mapping[str, Sequence[float | None]], clock: str) -> None:
    times = np.asarray(profile["times"], float)
    before, after = (np.array(profile[key], float) for key in ("before", "after"))
    axes.fill_between(times, after, before, color=ORANGE, alpha=0.15, linewidth=0)
    axes.plot(times, before, color=ORANGE, label=WITHOUT)
    axes.plot(times, after, color=GREEN, label=WITH)
    axes.axhline(1, color=GREY, linewidth=0.8, linestyle=(0, (2, 2)))
    axes.set(xlabel=clock, ylabel="misfit / noise σ", xlim=(times[0], times[-1]))
    axes.set_title("misfit of all fit sensors; dashed: noise of the recording", fontsize=9)
    _scale(axes, np.concatenate([before, after]), along_x=False)


def _draw_shares(axes: Axes, shares: Mapping[str, float]) -> None:
    axes.grid(False)
    axes.set_axis_off()
    axes.set(xlim=(0, 1), ylim=(-1.2, 0.6))
    axes.set_title("in the equation of", fontsize=9)
    colours = (VERMILION, BLUE, GREEN, ORANGE)
    left = 0.0
    for index, share in enumerate(shares.values()):
        colour = colours[index % len(colours)]
        axes.barh(0, share, left=left, color=colour, height=0.7, edgecolor="white", linewidth=1.5)
        left += share
    texts = [f"{field} {percent(share)}" for field, share in shares.items()]
    for index, text in enumerate(texts):
        place = index / max(1, len(texts) - 1)
        side = {0: "left", len(texts) - 1: "right"}.get(index, "center")
        colour = colours[index % len(colours)]
        axes.text(place, -0.95, text, ha=side, color=colour, fontsize=8.5, fontweight="bold")


def _draw_sensors(axes: Axes, sensors: Sequence[Mapping[str, Any]], total: int) -> None:
    """Draw the misfit of each sensor without and with the law, joined by a line."""
    axes.grid(False, axis="y")
    axes.grid(True, axis="x")
    for row, sensor in enumerate(sensors):
        before, after = np.sqrt(sensor["before"]), np.sqrt(sensor["after"])
        axes.plot([before, after], [row, row], color=LIGHT, linewidth=3.2, zorder=1)
        axes.plot(before, row, "o", color=ORANGE, markersize=6, label=WITHOUT if not row else None)
        axes.plot(after, row, "o", color=GREEN, markersize=6, label=WITH if not row else None)
    axes.axvline(1, color=GREY, linewidth=0.8, linestyle=(0, (2, 2)), zorder=0)
    axes.set_yticks(range(len(sensors)), [sensor["name"] for sensor in sensors])
    axes.tick_params(axis="y", length=0)
    axes.spines["left"].set_visible(False)
    axes.set_ylim(len(sensors) - 0.4, -0.6)
    axes.set_xlabel("misfit / noise σ")
    shown = f"{len(sensors)} of {total} sensors with the largest gain"
    title = "at each fit sensor" if len(sensors) == total else shown
    axes.set_title(title, fontsize=9)
    known = [np.sqrt(sensor[key]) for sensor in sensors for key in ("before", "after")]
    _scale(axes, np.array(known), along_x=True)


def _choose(
    sensors: Sequence[Mapping[str, Any]], law_map: LawMap | None
) -> list[Mapping[str, Any]]:
    """Return the sensors with the largest gain, in the order of the map if there is one."""
    known = [sensor for sensor in sensors if sensor["gain"] is not None]
    chosen = sorted(known, key=lambda sensor: -sensor["gain"])[:MAX_SENSORS]
    if law_map is None:
        return chosen
    places = law_map.sensors
    return sorted(chosen, key=lambda sensor: -places.get(sensor["name"], 0.0))


def _scale(axes: Axes, values: Float[np.ndarray, " n"], *, along_x: bool) -> None:
    finite = values[np.isfinite(values) & (values > 0)]
    logarithmic = bool(finite.size) and finite.max() > 6 * finite.min()
    if not logarithmic:
        axes.set_xlim(left=0) if along_x else axes.set_ylim(bottom=0)
        return
    axes.set_xscale("log") if along_x else axes.set_yscale("log")
    ticks = axes.xaxis if along_x else axes.yaxis
    few = finite.max() < 300 * finite.min()
    ticks.set_major_locator(LogLocator(subs=(1, 2, 5) if few else (1,)))
    ticks.set_major_formatter(FuncFormatter(lambda value, _: f"{value:g}"))
    ticks.set_minor_formatter(NullFormatter())
