"""The scorer's figures: SHRED and DA-SHRED are drawn once if they are equal."""

from __future__ import annotations

import numpy as np
import xarray as xr

from dashred.core.findings.methods import LABELS, SHRED_UNCHANGED
from dashred.evaluation.comparison.ratios import FIELDS
from dashred.evaluation.twins.truth_figures import methods_to_draw


def estimates(change: float) -> xr.Dataset:
    """Three methods' fields; DA-SHRED's is SHRED's and a change."""
    values = np.sin(np.arange(12.0)).reshape(4, 3)
    fields = np.stack([values, values + change, 2 * values])
    methods = ["shred", "dashred", "corrected"]
    return xr.Dataset({"u": (("method", "time", "x"), fields)}, {"method": methods})


def test_fields_that_are_equal_are_drawn_once() -> None:
    assert methods_to_draw(estimates(0.0)) == {SHRED_UNCHANGED: "shred", "corrected": "corrected"}
    assert list(methods_to_draw(estimates(1e-3))) == ["shred", "dashred", "corrected"]


def test_figures_call_methods_what_the_tables_call_them() -> None:
    """One name leans on the row above it in a table, and stands alone in a key."""
    alone = {name: told for name, told in FIELDS.items() if name != "filter_augmented"}
    assert alone.items() <= LABELS.items()
