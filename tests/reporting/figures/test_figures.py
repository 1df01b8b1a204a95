"""Figures: they show what they were given, say what it is, and are the same bytes every time."""

from pathlib import Path

import matplotlib as mpl
import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from dashred.core.formatting import pretty
from dashred.reporting.figures.coefficients import spread_out
from dashred.reporting.figures.fields.cells import scale_reference
from dashred.reporting.figures.save import (
    LatentPath,
    SensorError,
    accuracy_against_sparsity,
    coefficients_against_epoch,
    error_curves_figure,
    force_over_time,
    forecast_figure,
    learning_curves,
    rmse_against_time,
    save_figure,
    sensor_traces,
    space_time_panels,
    state_traces,
    verification_figure,
)

TIMES = np.linspace(0, 10, 41)
NO_ERRORS: dict[str, dict[str, float | None]] = {
    name: {} for name in ("test_sensors", "heldout_time", "heldout_restarted")
}
X = np.linspace(0, 6, 24, endpoint=False)
TRUTH = np.sin(X[None] - TIMES[:, None])


def titles(figure: Figure) -> list[str]:
    return [axes.get_title(loc="left") for axes in figure.axes if axes.get_title(loc="left")]


def texts(figure: Figure) -> str:
    from matplotlib.text import Text

    return "\n".join(found.get_text() for found in figure.findobj(Text))


def space_time() -> Figure:
    kinds = {"truth": TRUTH, "shred": TRUTH + 0.5 * TRUTH.std(), "dashred": TRUTH}
    return space_time_panels(
        TIMES, "x", X, {"u": kinds}, {"u": [1.0, 2.0]}, labels={"u": "u\nenergy"}, time_end=8.0
    )


def rmse() -> Figure:
    curves = {"simulation": 0.1 * TIMES, "dashred": 0.05 * TIMES}
    return rmse_against_time(TIMES, curves, 8.0, "RMSE / std")


def coefficients() -> Figure:
    epochs = np.arange(10)
    terms = {f"u: u**{k}": np.full(10, 0.1 * k) for k in range(12)}
    return coefficients_against_epoch(epochs, {"Algorithm 1": terms, "Algorithm 2": {}}, "SINDy")


def traces(sensors: int = 8, samples: int = 41) -> Figure:
    times = np.linspace(0, 10, samples)
    recorded = np.sin(times[:, None] + np.arange(sensors))
    recorded[3:6, 0] = np.nan
    names = [f"s{index}" for index in range(sensors)]
    roles = dict.fromkeys(names, "input") | {"s5": "test", "s6": "validate"}
    return sensor_traces(times, recorded, names, roles, {"shred": recorded}, 8.0)


def latent_path(rmse: list[float], kept: int) -> LatentPath:
    return LatentPath(np.arange(len(rmse)), np.array(rmse), 50, kept)


def path() -> Figure:
    latent = {"Algorithm 1": latent_path([1, 1 / 2, 1 / 3, 1 / 4, 1 / 5], 2)}
    law = [(0, 4.0, 900.0), (1, 1.0, 12.0), (2, 1.0, 25.0)]
    return accuracy_against_sparsity(latent, law, 1)


def test_the_ring_is_about_the_law_that_is_reported() -> None:
    """Another than the one of the lowest score, where causes were weighed; none where none is."""
    latent = {"Algorithm 1": latent_path([1.0, 1.0], 1)}
    law = [(0, 4.0, 900.0), (1, 1.0, 12.0), (2, 0.9, 25.0)]
    error, evidence = accuracy_against_sparsity(latent, law, 2).axes[2:]
    for axes, value in ((error, 0.9), (evidence, 13.0)):
        _, ring = axes.get_lines()
        np.testing.assert_array_equal(ring.get_xydata(), [[2, value]])
        assert axes.get_xlabel() == "number of terms (ring: reported)"
    for axes in accuracy_against_sparsity(latent, law, None).axes[2:]:
        assert len(axes.get_lines()) == 1
        assert axes.get_xlabel() == "number of terms (the reported law is not shown)"


def test_latent_sindy_has_evidence_of_what_it_keeps() -> None:
    """A term that explains nothing costs ln n; n are the parts of the record."""
    assert latent_path([1.0, 1.0], 0).evidence == pytest.approx([0, np.log(50)])
    rmse = [1.0, 0.1]
    assert latent_path(rmse, 0).evidence == pytest.approx([100 * np.log(10) - np.log(50), 0])
    assert np.isfinite(latent_path([1.0, 0.0], 0).evidence).all()


def test_a_law_that_errs_more_than_a_smaller_one_is_hollow_and_not_joined() -> None:
    latent = {"Algorithm 1": latent_path([1.0, 0.5], 1)}
    law = [(0, 4.0, 900.0), (1, 1.0, 12.0), (2, 3.0, 700.0), (3, 0.99, 30.0)]
    figure = accuracy_against_sparsity(latent, law, 1)
    for axes in figure.axes[2:]:
        joined, hollow, _ = axes.get_lines()
        np.testing.assert_array_equal(joined.get_xdata(), [0, 1, 3])
        np.testing.assert_array_equal(hollow.get_xdata(), [2])
        assert hollow.get_markerfacecolor() == "none"
    assert "did not converge" in texts(figure)
    assert "did not converge" not in texts(path())


def learning() -> Figure:
    values = np.array([1.0, 0.4, 0.3, 0.35, np.nan])
    return learning_curves({"validation": (np.arange(5), values)})


@pytest.mark.parametrize("make", [space_time, rmse, coefficients, traces, path, learning])
def test_the_same_figure_gives_the_same_bytes(tmp_path: Path, make: object) -> None:
    assert callable(make)
    for name in ("a.png", "b.png"):
        save_figure(make(), tmp_path / name)
    assert (tmp_path / "a.png").read_bytes() == (tmp_path / "b.png").read_bytes()
    assert sorted(file.name for file in tmp_path.iterdir()) == ["a.png", "b.png"]


@pytest.mark.parametrize("make", [space_time, rmse, coefficients, traces, path, learning])
def test_every_panel_with_ink_has_its_axes_labelled(make: object) -> None:
    assert callable(make)
    labels = {axes.get_xlabel() for axes in make().axes} | {
        axes.get_ylabel() for axes in make().axes
    }
    assert labels & {"time", "epoch", "number of terms (ring: chosen)"}
    assert labels - {"", "time", "epoch"}


def test_a_reader_s_own_settings_change_nothing(tmp_path: Path) -> None:
    save_figure(rmse(), tmp_path / "a.png")
    with mpl.rc_context({"font.size": 30, "axes.facecolor": "red", "savefig.dpi": 30}):
        save_figure(rmse(), tmp_path / "b.png")
        assert mpl.rcParams["font.size"] == 30
    assert (tmp_path / "a.png").read_bytes() == (tmp_path / "b.png").read_bytes()


def test_a_figure_that_cannot_be_saved_leaves_nothing(tmp_path: Path) -> None:
    with pytest.raises(OSError, match="missing"):
        save_figure(rmse(), tmp_path / "missing" / "a.png")
    (tmp_path / "folder").mkdir()
    with pytest.raises(OSError, match="folder"):
        save_figure(rmse(), tmp_path / "folder")
    assert [file.name for file in tmp_path.iterdir()] == ["folder"]


def test_methods_share_the_scale_of_the_truth_and_errors_are_numbered() -> None:
    figure = space_time()
    images = [axes.images[0] for axes in figure.axes if axes.images]
    values, errors = images[:3], images[3:]
    assert len({image.get_clim() for image in values}) == 1
    assert {image.get_clim()[0] for image in errors} == {-errors[0].get_clim()[1]}
    assert titles(figure) == [
        "truth",
        "SHRED, randomised",
        "DA-SHRED",
        "error 0.5 std",
        "error 0 std",
    ]
    np.testing.assert_allclose(np.asarray(values[0].get_array()), TRUTH.T)
    assert "u\nenergy" in texts(figure)


def test_a_map_ends_where_its_points_do_and_each_cell_has_its_point_in_the_middle() -> None:
    """Beyond the end of a rod nothing is drawn."""
    x = np.linspace(0, 10, 33)
    figure = space_time_panels(TIMES, "x", x, {"u": {"truth": np.zeros((41, 33))}}, {})
    panel = figure.axes[0]
    assert panel.get_ylim() == (0, 10) and panel.get_xlim() == (0, 10)
    assert panel.images[0].get_extent()[2:] == pytest.approx((-10 / 64, 10 + 10 / 64))


def test_the_truth_lies_above_the_methods_that_hide_it() -> None:
    values = np.sin(TIMES)
    lines = state_traces(TIMES, {"u": {"truth": values, "shred": values + 0.1}}).axes[0].lines
    truth, shred = lines
    assert truth.get_zorder() > shred.get_zorder() and truth.get_linestyle() == "--"
    assert truth.get_linewidth() < shred.get_linewidth() < 3


def test_without_a_truth_there_is_no_error_row() -> None:
    fields = {"u": {"simulation": TRUTH, "shred": TRUTH}, "v": {"shred": np.zeros_like(TRUTH)}}
    figure = space_time_panels(TIMES, "x", X, fields, {})
    assert sum(bool(axes.images) for axes in figure.axes) == 3
    assert "error" not in texts(figure)


def test_rmse_goes_logarithmic_only_where_a_curve_would_vanish() -> None:
    assert rmse().axes[0].get_yscale() == "linear"
    curves = {"simulation": 1 + TIMES, "corrected": 0.001 * (1 + TIMES)}
    assert rmse_against_time(TIMES, curves, 8.0, "RMSE").axes[0].get_yscale() == "log"


def test_the_largest_coefficients_are_named_and_the_others_counted() -> None:
    found = texts(coefficients())
    assert "u: u¹¹   +1.1" in found
    assert "u: u⁴   +0.4" in found
    assert "u: u³" not in found
    assert "grey: 4 other terms" in found


def test_at_most_six_sensors_and_the_held_out_ones_first() -> None:
    figure = traces()
    assert titles(figure) == ["s5", "s6", "s0", "s1", "s2", "s3"]
    assert "6 of 8 sensors" in texts(figure)
    assert titles(traces(sensors=3)) == ["s0", "s1", "s2"]


def test_a_long_record_of_few_sensors_gets_a_panel_of_detail() -> None:
    figure = traces(sensors=1, samples=2000)
    assert [axes.get_xlim() for axes in figure.axes] == [(0, 10), (7.5, 8.5)]


def test_the_chosen_number_of_terms_is_ringed() -> None:
    ring = path().axes[0].lines[1]
    assert np.asarray(ring.get_xydata()).ravel() == pytest.approx([2, 1 / 3])


def test_the_best_epoch_is_told() -> None:
    assert "0.3 at epoch 2" in texts(learning())


@given(st.lists(st.floats(0, 1), max_size=12))
def test_labels_keep_their_order_and_their_distance(wanted: list[float]) -> None:
    heights = spread_out(wanted, 0.075)
    ranked = sorted(range(len(wanted)), key=lambda index: wanted[index])
    steps = np.diff([heights[index] for index in ranked])
    assert (steps >= 0.075 - 1e-9).all()
    assert all(-1e-9 <= height <= 1 + 1e-9 for height in heights)


def test_labels_with_room_stay_where_they_are() -> None:
    assert spread_out([0.9, 0.1, 0.5], 0.1) == pytest.approx([0.9, 0.1, 0.5])
    assert spread_out([0.5, 0.5], 0.1) == pytest.approx([0.45, 0.55])


@pytest.mark.parametrize(
    ("term", "expected"),
    [("u**2*lam", "u²·lam"), ("u**12", "u¹²"), ("u**0.5*v", "u**0.5*v"), ("d(u, x)", "d(u, x)")],
)
def test_terms_are_printed_as_in_books(term: str, expected: str) -> None:
    assert pretty(term) == expected


def test_axes_carry_the_units_of_what_they_show() -> None:
    values = np.sin(TIMES)[:, None]
    figures = [
        sensor_traces(TIMES, values, ["a"], {}, {}, 8.0, {"a": "rad"}, "time [s]"),
        verification_figure(
            TIMES, values, ["a"], {"corrected": values}, 8.0, NO_ERRORS, {"a": "rad"}, "time [s]"
        ),
        forecast_figure(TIMES, values[:20], ["a"], {"corrected": values}, {"a": "rad"}, "time [s]"),
    ]
    for figure in figures:
        labels = {axes.get_xlabel() for axes in figure.findobj(Axes)}
        labels |= {axes.get_ylabel() for axes in figure.findobj(Axes)}
        assert {"reading [rad]", "time [s]"} <= labels


def test_a_sensor_without_readings_has_no_panel() -> None:
    values = np.sin(TIMES)[:, None] * np.ones(3)
    values[:, 1] = np.nan
    names, roles = ["a", "b", "c"], {"b": "test"}
    figure = sensor_traces(TIMES, values, names, roles, {"shred": np.ones_like(values)}, 8.0)
    assert titles(figure) == ["a", "c"]
    nothing = np.full_like(values, np.nan)
    figure = sensor_traces(TIMES, nothing, names, roles, {"shred": np.ones_like(values)}, 8.0)
    assert titles(figure) == ["b", "a", "c"]


def test_a_forecast_shows_the_end_of_the_recording_and_all_beyond_it() -> None:
    values = np.sin(TIMES)[:, None] * np.ones(5)
    last = len(TIMES) // 2
    names = [f"s{i}" for i in range(5)]
    figure = forecast_figure(TIMES, values[: last + 1], names, {"corrected": values})
    assert len(figure.axes) == 3
    seen, line = figure.axes[0].lines[:2]
    recorded, foretold = np.asarray(seen.get_ydata()), np.asarray(line.get_ydata())
    begin = len(TIMES) - len(foretold)
    assert 0 < begin < last
    np.testing.assert_array_equal(foretold, values[begin:, 0])
    np.testing.assert_array_equal(recorded[: last + 1 - begin], values[begin : last + 1, 0])
    assert np.isnan(recorded[last + 1 - begin :]).all()


def test_a_forecast_is_framed_by_the_whole_recording_and_not_by_a_run_that_is_lost() -> None:
    values = np.sin(TIMES)[:, None]
    lost = 1e6 * np.ones_like(values)
    figure = forecast_figure(
        TIMES, values[:30], ["a"], {"simulation_refit": lost, "corrected": values}
    )
    low, high = figure.axes[0].get_ylim()
    assert -4 < low < values[:30].min() and values[:30].max() < high < 4


def test_the_error_of_a_sensor_is_drawn_with_its_band() -> None:
    value = 0.1 * np.sin(TIMES)
    error = SensorError(
        "s4, run2", TIMES, value + 0.01, TIMES, value, np.full_like(TIMES, 0.02), 8.0, "K"
    )
    figure = error_curves_figure([error, error])
    assert len(figure.axes) == 2 and titles(figure) == ["s4, run2"] * 2
    assert figure.axes[0].get_ylabel() == "error [K]"
    band = np.concatenate(
        [np.asarray(path.vertices) for c in figure.axes[0].collections for path in c.get_paths()]
    )
    inside = band[(band[:, 0] >= 0) & (band[:, 0] <= 8)]
    assert inside[:, 1].min() == pytest.approx(-0.14, abs=0.01)


def test_a_force_over_time_is_drawn_for_the_equations_that_it_acts_in() -> None:
    value = 0.1 * np.sin(TIMES)
    forcing = {
        "times": TIMES.tolist(),
        "amplitude": {"x": [[0.0] * len(TIMES)], "v": [value.tolist()]},
        "std": {"x": [[0.0] * len(TIMES)], "v": [[0.02] * len(TIMES)]},
    }
    figure = force_over_time(forcing, "time [s]")
    assert titles(figure) == ["equation of v"]
    [axes] = figure.axes
    np.testing.assert_allclose(np.asarray(axes.lines[0].get_ydata(), float), value)
    assert axes.get_xlabel() == "time [s]"


def test_the_best_estimate_sets_the_colour_scale() -> None:
    kinds = {"simulation": np.zeros(3), "shred": np.ones(3), "corrected": np.full(3, 2.0)}
    assert scale_reference(kinds)[0] == 2.0
    assert scale_reference(kinds | {"truth": np.full(3, 4.0)})[0] == 4.0
    assert scale_reference({"simulation": np.zeros(3), "shred": np.ones(3)})[0] == 0.0


def test_a_legend_with_long_labels_stays_in_its_figure(tmp_path: Path) -> None:
    names = ["SHRED, unseen simulations", "DA-SHRED, fitted", "DA-SHRED, validation"]
    curve = np.array([0.0, 1.0]), np.array([1.0, 0.00949])
    figure = learning_curves(dict.fromkeys(names, curve), "RMSE / standard deviation")
    save_figure(figure, tmp_path / "learning.png")
    [legend] = figure.legends
    assert legend.get_window_extent().x1 <= figure.bbox.x1
