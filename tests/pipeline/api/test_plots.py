"""The figures of a result are drawn when they are asked for."""

from __future__ import annotations

import pytest
from matplotlib.figure import Figure

import dashred


@pytest.mark.parametrize(
    "name",
    [
        *("where", "verification", "forecast", "evidence", "fields"),
        *("sensors", "coefficients", "sparsity", "learning"),
    ],
)
def test_each_is_a_figure(result: dashred.Result, name: str) -> None:
    figure = getattr(result.plot, name)()
    assert isinstance(figure, Figure) and figure.axes


def test_one_that_there_is_not_names_those_that_there_are(result: dashred.Result) -> None:
    with pytest.raises(dashred.InputError, match="has no figure forcing\n  it has sensor_traces"):
        result.plot.forcing()
    assert "where" in repr(result.plot)
