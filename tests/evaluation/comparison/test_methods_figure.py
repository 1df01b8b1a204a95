"""Every method's error against time: what is missing or not finite takes no other with it."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from dashred.evaluation.comparison.methods_figure import (
    METHODS_FIGURE,
    draw_methods,
    methods_figure,
)

TIMES = np.linspace(0, 1, 5)


def test_methods_that_are_there_are_drawn_in_the_order_of_the_key() -> None:
    lost = np.array([0.1, 1.0, 1e9, np.inf, np.nan])
    curves = {"corrected": np.full(5, 1e-3), "filter_state": lost, "simulation": np.ones(5)}
    [axes] = methods_figure(TIMES, curves).axes
    assert [line.get_label() for line in axes.lines] == [
        "ensemble Kalman filter",
        "dashred: corrected simulator",
    ]
    low, high = axes.get_ylim()
    assert axes.get_yscale() == "log" and low < 1e-3 and 1 < high < 100


def test_a_row_without_any_finite_error_has_a_figure_still(tmp_path: Path) -> None:
    draw_methods(tmp_path, TIMES, {"shred": np.full(5, np.nan), "corrected": np.zeros(5)}, {})
    draw_methods(tmp_path, TIMES, {}, {"t": "s"})
    assert (tmp_path / METHODS_FIGURE).is_file()
