"""All figures of a run, as one module."""

from dashred.reporting.figures.coefficients import coefficients_against_epoch
from dashred.reporting.figures.curves import epochs_and_values, learning_curves, rmse_against_time
from dashred.reporting.figures.error_curves import SensorError, error_curves_figure
from dashred.reporting.figures.evidence import evidence_figure
from dashred.reporting.figures.fields.forcing import forcing_figure
from dashred.reporting.figures.fields.front import front_figure
from dashred.reporting.figures.fields.location import LawMap, where_figure
from dashred.reporting.figures.fields.snapshots import snapshot_panels
from dashred.reporting.figures.fields.space_time import space_time_panels
from dashred.reporting.figures.fields.state_traces import state_traces
from dashred.reporting.figures.force_over_time import force_over_time
from dashred.reporting.figures.forecast import forecast_figure
from dashred.reporting.figures.held_out import verification_figure
from dashred.reporting.figures.sparsity import LatentPath, accuracy_against_sparsity
from dashred.reporting.figures.style import save_figure
from dashred.reporting.figures.traces import sensor_traces

__all__ = [
    "LatentPath",
    "LawMap",
    "SensorError",
    "accuracy_against_sparsity",
    "coefficients_against_epoch",
    "epochs_and_values",
    "error_curves_figure",
    "evidence_figure",
    "force_over_time",
    "forcing_figure",
    "forecast_figure",
    "front_figure",
    "learning_curves",
    "rmse_against_time",
    "save_figure",
    "sensor_traces",
    "snapshot_panels",
    "space_time_panels",
    "state_traces",
    "verification_figure",
    "where_figure",
]
