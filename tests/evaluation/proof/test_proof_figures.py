"""The proof's figures: they show the counts, and can be drawn of few cases or none."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from matplotlib.figure import Figure
from matplotlib.text import Text

from dashred.evaluation.proof.cases.case_record import CaseRecord
from dashred.evaluation.proof.figures import (
    FIGURES,
    coverage_figure,
    gains_figure,
    reliability,
    reliability_figure,
    save_figures,
    scores_figure,
)
from dashred.evaluation.proof.scoring.statistics import Rate
from tests.evaluation.proof.invented import case, coefficient, dead, null, proof, wrong


def texts(figure: Figure) -> list[str]:
    return [found.get_text() for found in figure.findobj(Text)]


def curves(figure: Figure) -> dict[str, tuple[np.ndarray, np.ndarray]]:
    return {
        str(line.get_label()): (np.asarray(line.get_xdata()), np.asarray(line.get_ydata()))
        for line in figure.axes[0].lines
    }


FEW = {
    "none": [],
    "one": [case()],
    "a null": [null()],
    "a dead one": [dead()],
    "no stds": [case(coefficients=[coefficient(std=None)], probability=None)],
    "half a gain": [case(gains={"test_sensors": None, "forecast": 3.0})],
}


@pytest.mark.parametrize("records", FEW.values(), ids=FEW)
def test_few_cases_are_no_reason_to_fail(records: list[CaseRecord], tmp_path: Path) -> None:
    save_figures(records, tmp_path / "figures")
    assert sorted(file.name for file in (tmp_path / "figures").iterdir()) == sorted(FIGURES)


def test_the_same_records_give_the_same_bytes(tmp_path: Path) -> None:
    for name in ("a", "b"):
        save_figures(proof(), tmp_path / name)
    for name in FIGURES:
        assert (tmp_path / "a" / name).read_bytes() == (tmp_path / "b" / name).read_bytes()


def test_scores_have_a_bar_and_a_count_for_each_class_that_there_is() -> None:
    records = [case(kind="box"), wrong(kind="box"), case(kind="fault"), null()]
    figure = scores_figure(records)
    names = [label.get_text() for label in figure.axes[0].get_yticklabels()]
    assert names == ["all cases", "a faulty sensor", "a term in a region", "nulls, separately"]
    counts = [text for text in texts(figure) if "/" in text]
    assert counts == ["2/3", "1/1", "1/2", "1/1"]


def test_stated_probabilities_are_binned_with_their_counts() -> None:
    records = [case(probability=0.95)] * 3 + [wrong(probability=0.6, verdict="ambiguous")]
    low, high = reliability([*records, dead(), null(probability=0.6)])
    assert (low.low, low.high, low.mean, low.right) == (0.5, 0.7, 0.6, Rate(0, 1))
    assert (high.low, high.high, high.right) == (0.9, 0.98, Rate(3, 3))
    assert {"0/1", "3/3"} <= set(texts(reliability_figure(records)))


def test_every_case_lies_in_a_bin() -> None:
    records = [case(probability=p) for p in (1e-3, 0.5, 0.7, 0.9, 0.98, 1.0)]
    assert sum(stated.right.n for stated in reliability(records)) == len(records)


def test_coverage_climbs_where_the_deviations_lie() -> None:
    # One std off and two: intervals of less than 68 % cover neither, of 95.4 % or more both.
    found = [coefficient(found=-0.151), coefficient(found=-0.148)]
    figure = coverage_figure([case(coefficients=found), case(kind="box")])
    x, y = curves(figure)["everywhere: 2"]
    np.testing.assert_allclose(x, [0, 0.6827, 0.9545, 1], atol=1e-4)
    np.testing.assert_array_equal(y, [0, 0.5, 1, 1])
    assert "in a region: 1" in curves(figure) and "gated by the state: 0" not in curves(figure)


def test_gains_are_dots_by_class_with_their_median() -> None:
    gains = [{"test_sensors": gain, "forecast": 10 * gain} for gain in (2.0, 4.0, 50.0)]
    records = [case(gains=gain) for gain in gains] + [case(kind="fault")]
    figure = gains_figure(records)
    assert figure.axes[0].get_xscale() == "log"
    dots, _ = curves(figure)["test sensors: 3"]
    np.testing.assert_array_equal(dots, [2, 4, 50])
    ticks = [line.get_xdata() for line in figure.axes[0].lines if line.get_marker() == "|"]
    np.testing.assert_array_equal(np.asarray(ticks), [[4], [40]])
    assert [label.get_text() for label in figure.axes[0].get_yticklabels()] == ["missing terms"]
