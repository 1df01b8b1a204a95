"""The names of the compared methods: in `findings.json`, `estimates.nc`, tables and figures.

`simulation` runs from the nominal initial state, `simulation_same_start` from the initial state
fitted with the law, and `simulation_refit` from the initial state that fits best without a law.
`corrected` is the model as told: the simulation with the law, from the fitted initial state, and
with the sensors corrected. Without a law, `simulation_same_start` equals `simulation`.
"""

from collections.abc import Mapping
from typing import TypeVar

Value = TypeVar("Value")

# One curve for both: DA-SHRED equals SHRED if no latent transform was accepted.
SHRED_UNCHANGED = "shred = dashred"

LABELS = {
    "truth": "truth",
    "recorded": "recorded",
    "nearest_snapshots": "nearest snapshots",
    "simulation": "simulation, nominal start",
    "simulation_same_start": "simulation, same start",
    "simulation_refit": "simulation, best start",
    "optimal_interpolation": "optimal interpolation",
    "closed_form": "closed form of linear systems",
    "filter_state": "ensemble Kalman filter",
    "filter_augmented": "ensemble Kalman filter with coefficients",
    "shred_plain": "SHRED, plain",
    "pyshred": "pyshred, recommended settings",
    "pyshred_tuned": "pyshred, tuned",
    "shred": "SHRED, randomised",
    "dashred": "DA-SHRED",
    SHRED_UNCHANGED: "SHRED = DA-SHRED",
    "corrected": "dashred: corrected simulator",
    "corrected_shred": "dashred: corrected SHRED",
    "observer": "dashred: observer",
}
"""The label of each method, by its name in the files."""

AT_SENSORS = (
    "nearest_snapshots",
    "simulation",
    "simulation_same_start",
    "simulation_refit",
    "shred_plain",
    "shred",
    "dashred",
    "corrected",
)
"""The methods whose errors at sensors are reported, in the order of the tables."""

DEPRECATED = {
    "before": "simulation_same_start",
    "before_refit": "simulation_refit",
    "after": "corrected",
    "snapshots": "nearest_snapshots",
}
"""Names of earlier releases, and the names that replace them. The next release removes them."""


def method_label(method: str) -> str:
    """Return the label of a method, or its name if it has none."""
    return LABELS.get(method, method)


def with_deprecated(values: Mapping[str, Value]) -> dict[str, Value]:
    """Return values by method, each also under the deprecated name of its method."""
    return dict(values) | {old: values[new] for old, new in DEPRECATED.items() if new in values}


def current_names(values: Mapping[str, Value]) -> dict[str, Value]:
    """Return values by the current names of their methods, as read from a file of any release."""
    renamed = {DEPRECATED[name]: value for name, value in values.items() if name in DEPRECATED}
    return renamed | {name: value for name, value in values.items() if name not in DEPRECATED}
