"""The figures of a run: file name, caption, and section of the report."""

from __future__ import annotations

import re
from pathlib import Path

# Every figure has this text at the start of its PNG file.
SOFTWARE = "dashred"
SIGNATURE = f"tEXtSoftware\0{SOFTWARE}".encode()

# Sections of the report.
WHERE, WHAT, PROOF, FORECAST, METHOD = "where", "what", "proof", "forecast", "method"
SENSORS_CAPTION, HELD_OUT_EPISODE = "All sensors", "held_out_episode.png"
SENSOR_ERRORS = "sensor_errors.png"

Captions = dict[str, dict[str, str]]
"""File name by caption, by section."""

OF_EQUATIONS: Captions = {
    WHERE: {
        "Where the law acts, and at which sensors it reduces the misfit": "where.png",
        "The forcing that no law expresses, by place and time": "forcing.png",
        "The errors of faulty sensors over time": SENSOR_ERRORS,
    },
    WHAT: {"The missing terms and their evidence": "evidence.png"},
    PROOF: {
        "Errors with and without the law, on held-out data": "verification.png",
        "The held-out episode, from a start fitted to its beginning": HELD_OUT_EPISODE,
        "The reconstructed field": "space_time.png",
        "The reconstructed field, at three times": "snapshots.png",
        SENSORS_CAPTION: "sensor_traces.png",
    },
    FORECAST: {"Forecasts of the sensors with and without the law": "forecast.png"},
    METHOD: {
        "Proposals of latent SINDy by epoch": "coefficients.png",
        "Accuracy against sparsity: latent SINDy, and the law": "sparsity.png",
        "Learning": "learning.png",
    },
}
OF_SNAPSHOTS: Captions = {
    PROOF: {
        "The reconstructed field": "space_time.png",
        "The reconstructed field, at three times": "snapshots.png",
        SENSORS_CAPTION: "sensor_traces.png",
    },
    METHOD: {
        "Proposals of latent SINDy by epoch, untested": "coefficients.png",
        "Learning": "learning.png",
    },
}
# The scorer draws these figures from the truth; they are not in the report.
OF_THE_TRUTH = (
    "rmse_against_time.png",
    "state_truth.png",
    "space_time_truth.png",
    "snapshots_truth.png",
    "front_truth.png",
    "methods_truth.png",
)
OF_LATER_EPISODES = re.compile(r"sensor_traces_[0-9]+\.png")


def sensor_figure_of_episode(number: int) -> str:
    """Return the file name of the sensor traces of an episode, counted from 1."""
    return f"sensor_traces_{number}.png" if number > 1 else "sensor_traces.png"


def is_figure(name: str) -> bool:
    """Return whether this is the name of a figure of dashred."""
    captions = (*OF_EQUATIONS.values(), *OF_SNAPSHOTS.values())
    named = {file for drawn in captions for file in drawn.values()}
    return name in named or name in OF_THE_TRUTH or bool(OF_LATER_EPISODES.fullmatch(name))


def is_report_figure(path: Path) -> bool:
    """Whether a file is a figure of dashred, by its name and by its PNG text."""
    if not is_figure(path.name) or not path.is_file():
        return False
    with path.open("rb") as file:
        return SIGNATURE in file.read(1024)
