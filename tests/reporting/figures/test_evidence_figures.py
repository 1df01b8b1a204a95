"""The figures of the law: what they are given they show, and what is unknown they leave out."""

from pathlib import Path
from typing import Any

import numpy as np
import pytest
from matplotlib.axes import Axes
from matplotlib.collections import PathCollection
from matplotlib.container import ErrorbarContainer
from matplotlib.figure import Figure
from matplotlib.patches import Rectangle
from matplotlib.text import Text

from dashred.reporting.figures.save import (
    LawMap,
    evidence_figure,
    save_figure,
    verification_figure,
    where_figure,
)

TIMES = np.linspace(0, 8, 41)
X = np.linspace(0, 6, 24, endpoint=False)
TERMS: list[dict[str, Any]] = [
    {
        "equation": "u",
        "term": "u**3",
        "coefficient": -0.0251,
        "std": 4e-4,
        "ci95": [-0.026, -0.024],
    },
    {"equation": None, "term": "nu", "coefficient": 0.015, "std": 5e-4, "ci95": [0.049, 0.051]},
]
PATH = [(2, 0.0), (0, 5400.0), (1, 800.0), (3, 11.0)]
ERRORS: dict[str, dict[str, float | None]] = {
    "test_sensors": {"simulation_same_start": 0.61, "simulation_refit": 0.4, "corrected": 0.052},
    "heldout_time": {"simulation_same_start": None, "simulation_refit": 0.71, "corrected": 0.081},
    "heldout_restarted": {
        "simulation_same_start": None,
        "simulation_refit": 0.15,
        "corrected": 0.03,
    },
}


def where(sensors: int = 4, fields: tuple[str, ...] = ("u", "lam")) -> dict[str, Any]:
    gains = [
        {"name": f"s{i}", "before": 4.0 + i, "after": 1.0, "gain": 3.0 + i, "p": 0.0}
        for i in range(sensors)
    ]
    gains.append({"name": "dead", "before": None, "after": None, "gain": None, "p": None})
    before = [1.0 + t for t in TIMES]
    return {
        "equation": dict(zip(fields, (0.97, 0.03), strict=False)),
        "region": None,
        "regime": "u > 1.2 (39 % of space and time carries 80 % of it)",
        "sensors": gains,
        "profile": {"times": list(TIMES), "before": before, "after": [None] + [1.0] * 40},
        "forcing": None,
    }


def line() -> LawMap:
    size = np.abs(np.sin(X[None] - TIMES[:, None]))
    return LawMap("x", X, TIMES, size, {"s0": 1.0, "s1": 5.0, "s2": 3.0, "s3": 2.0})


def texts(figure: Figure) -> list[str]:
    return [found.get_text() for found in figure.findobj(Text)]


def bars(axes: Axes) -> list[Rectangle]:
    return [patch for patch in axes.patches if isinstance(patch, Rectangle)]


def verified(sensors: int = 5) -> Figure:
    recorded = np.sin(TIMES[:, None] + np.arange(sensors))
    traces = {
        name: recorded * f
        for name, f in (
            ("simulation_same_start", 50.0),
            ("simulation_refit", 0.5),
            ("corrected", 1.0),
        )
    }
    names = [f"t{i}" for i in range(sensors)]
    return verification_figure(TIMES, recorded, names, traces, 6.0, ERRORS)


@pytest.mark.parametrize(
    "make",
    [lambda: where_figure(where(), line()), lambda: evidence_figure(PATH, TERMS, 0), verified],
)
def test_the_same_figure_gives_the_same_bytes(make: Any, tmp_path: Path) -> None:
    for name in ("a.png", "b.png"):
        save_figure(make(), tmp_path / name)
    assert (tmp_path / "a.png").read_bytes() == (tmp_path / "b.png").read_bytes()


def test_the_map_is_the_laws_size_with_every_sensor_at_its_place() -> None:
    figure = where_figure(where(), line())
    [image] = [axes.images[0] for axes in figure.axes if axes.images]
    np.testing.assert_allclose(np.asarray(image.get_array()), line().size.T)
    assert image.get_clim()[0] == 0
    marks = [m for m in figure.findobj(PathCollection) if len(np.asarray(m.get_offsets())) == 4]
    assert sorted(np.asarray(marks[0].get_offsets())[:, 1]) == [1.0, 2.0, 3.0, 5.0]
    assert any("it acts where u > 1.2 (39 %" in text for text in texts(figure))


def test_sensors_run_down_the_map_and_a_dead_one_is_left_out() -> None:
    figure = where_figure(where(), line())
    shown = [text for text in texts(figure) if text in {"s0", "s1", "s2", "s3", "dead"}]
    assert list(dict.fromkeys(shown)) == ["s1", "s2", "s3", "s0"]


def test_of_many_sensors_those_that_gain_most_are_shown() -> None:
    figure = where_figure(where(sensors=40))
    told = texts(figure)
    assert "18 of 41 sensors with the largest gain" in told
    assert "s39" in told and "s22" in told and "s21" not in told
    assert not any(axes.images for axes in figure.axes)


def test_the_shares_of_equations_need_two_equations() -> None:
    assert {"u 97 %", "lam 3 %"} <= set(texts(where_figure(where())))
    assert "in the equation of" not in texts(where_figure(where(fields=("u",))))


def test_the_best_size_is_ringed_and_the_law_is_named() -> None:
    figure = evidence_figure(PATH, TERMS, 0)
    curve, ring = figure.axes[0].lines
    np.testing.assert_array_equal(curve.get_xdata(), [0, 1, 2, 3])
    np.testing.assert_array_equal(curve.get_ydata(), [5400, 800, 0, 11])
    assert list(np.asarray(ring.get_xdata())) == [2]
    assert "ring:\nu: u³\nchange of nu" in texts(figure)
    assert any("−0.0251 ± 0.0008" in text for text in texts(figure))


def test_a_law_off_the_path_has_no_ring() -> None:
    assert list(np.asarray(evidence_figure(PATH, TERMS, 3).axes[0].lines[1].get_ydata())) == [11]
    figure = evidence_figure(PATH, TERMS, None)
    assert len(figure.axes[0].lines) == 1
    assert "reported (not shown):\nu: u³\nchange of nu" in texts(figure)


def test_a_parameters_interval_is_drawn_about_its_change() -> None:
    axes = evidence_figure(PATH, TERMS, 0).axes[1]
    [errors] = [c for c in axes.containers if isinstance(c, ErrorbarContainer)]
    segments = errors.lines[2][0].get_segments()
    np.testing.assert_allclose(segments[1][:, 0], [0.014, 0.016])


def test_small_coefficients_do_not_vanish_beside_large_ones() -> None:
    small = TERMS[0] | {"coefficient": 1e-5, "std": 1e-6, "ci95": [8e-6, 1.2e-5]}
    axes = evidence_figure(PATH, [TERMS[0], small], 0).axes[1]
    assert axes.get_xlabel() == "coefficient / its magnitude"
    assert [round(bar.get_width(), 6) for bar in bars(axes)] == [-1, 1]


def test_a_law_of_nothing_can_be_drawn() -> None:
    figure = evidence_figure([(0, 0.0)], [], 0)
    assert "no term is added" in texts(figure) and "ring:\nno term" in texts(figure)


def test_three_test_sensors_with_the_recordings_own_scale() -> None:
    figure = verified()
    told = texts(figure)
    assert {"t0", "t1", "t2"} <= set(told) and "t3" not in told
    assert "held-out time" in told
    [low, high] = figure.axes[0].get_ylim()
    assert high - low < 6  # one that runs away would need a hundred


def test_every_known_error_is_a_bar_with_its_number() -> None:
    heights = [round(bar.get_height(), 3) for bar in bars(verified().axes[-1])]
    assert heights == [0.61, 0.4, 0.052, 0.71, 0.081, 0.15, 0.03]
    assert {"0.61", "0.4", "0.052", "0.71", "0.081", "0.15", "0.03"} <= set(texts(verified()))


def test_without_test_sensors_the_bars_stand_alone_with_a_legend() -> None:
    figure = verified(sensors=0)
    assert len(figure.axes) == 1
    assert "dashred: corrected simulator" in texts(figure)


def test_the_map_of_a_forcing_shows_the_equations_of_which_it_is_sure() -> None:
    from dashred.reporting.figures.save import forcing_figure

    size = np.zeros((4, 3))
    size[1] = 0.5
    forcing = {
        "times": [0.0, 1.0, 2.0],
        "amplitude": {"u": size.tolist(), "v": (0.1 * size).tolist()},
        "std": {"u": np.full((4, 3), 0.1).tolist(), "v": np.full((4, 3), 0.1).tolist()},
    }
    figure = forcing_figure(forcing, "x", (0.0, 8.0), [1.0, 5.0])
    panels = [axes for axes in figure.axes if axes.images]
    assert [axes.get_title(loc="left") for axes in panels] == ["equation of u"]
    [image] = panels[0].images
    assert np.array_equal(np.asarray(image.get_array()), size) and image.get_clim() == (-0.5, 0.5)
    [dots] = [line for line in panels[0].lines if line.get_marker() == "."]
    assert np.size(dots.get_xdata()) == 9
    source = {"equation": "u", "place": [3.0], "region": [{"axis": "x", "from": 2.0, "to": 4.0}],
              "times": [0.0, 2.0], "rates": [0.1, 0.4]}  # fmt: skip
    marked = forcing_figure(forcing, "x", (0.0, 8.0), [1.0, 5.0], source=source)
    course = marked.axes[1]
    assert course.lines[0].get_ydata() == pytest.approx([0.1, 0.4])
    edges = [
        np.ravel(line.get_ydata())[0]
        for line in marked.axes[0].lines
        if line.get_linestyle() == "--"
    ]
    assert edges == [2.0, 4.0]
