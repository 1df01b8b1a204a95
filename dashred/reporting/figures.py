"""All figures of a run, from one place."""

from dashred.reporting.coefficients import coefficients_against_epoch
from dashred.reporting.curves import learning_curves, rmse_against_time, sparsity_path
from dashred.reporting.space_time import space_time_panels
from dashred.reporting.style import save_figure
from dashred.reporting.traces import sensor_traces

__all__ = [
    "coefficients_against_epoch",
    "learning_curves",
    "rmse_against_time",
    "save_figure",
    "sensor_traces",
    "space_time_panels",
    "sparsity_path",
]
