"""Open the seal and score frozen findings: ``dashred score findings=DIR sealed=FILE``.

This is the only command that reads a hidden truth. It refuses findings that are not frozen or have
changed since.
"""

from __future__ import annotations

import json
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

from dashred.core.command_line.argument_types import read_path
from dashred.core.command_line.arguments import COMMAND_LINE, Command, argument
from dashred.core.errors import DONE, InputError
from dashred.core.findings.findings import check_freeze, write_json_atomic
from dashred.core.findings.methods import DEPRECATED, current_names, with_deprecated

if TYPE_CHECKING:
    import numpy as np
    import xarray as xr

    from dashred.core.findings.schema import Score
    from dashred.evaluation.twins.sealing import Truth

REGIONS = {
    "overlap": "Intersection over union of the region found and the true one:",
    "onset": "Error of the onset:",
    "threshold": "Error of the threshold:",
}
# Largest difference of equal times, in units of time.
TIME_TOLERANCE = 1e-9


@dataclass(frozen=True, kw_only=True)
class Arguments:
    """The words of the command."""

    findings: Path = argument(read_path, "DIR", "folder of the frozen findings")
    sealed: Path = argument(read_path, "FILE", "the truth, sealed.nc")
    root: str | None = argument(str, "DIR", "of the MLflow store, with run=", default=None)
    experiment: str | None = argument(str, "NAME", "of the run, with run=", default=None)
    run: str | None = argument(str, "RUN_ID", "the MLflow run that gets the score", default=None)


COMMAND = Command("dashred score", Arguments, "Compares frozen findings with the hidden truth.")


def main(argv: list[str]) -> int:
    """Score one run; with ``root``, ``experiment`` and ``run``, also log the score to MLflow."""
    words = COMMAND.read(argv)
    output, run = words.findings, _run_of(words)
    check_freeze(output)
    score, truth, figures = score_findings(output, words.sealed)
    write_json_atomic(output / "score.json", score)
    _print_score(score)
    if run is not None:
        _log(*run, score, truth, [output / "score.json", output / "recording.nc", *figures])
    return DONE


def _run_of(words: Arguments) -> tuple[str, str, str] | None:
    """Return the store, the experiment and the id of the run that gets the score; None without.

    Raises:
        InputError: one of them is missing.
    """
    root, experiment, run = words.root, words.experiment, words.run
    if root is None and experiment is None and run is None:
        return None
    if root is None or experiment is None or run is None:
        raise InputError("root=, experiment= and run= must be given together", where=COMMAND_LINE)
    return root, experiment, run


def score_findings(output: Path, sealed: Path) -> tuple[Score, Truth, list[Path]]:
    """Compare frozen findings with the truth; return the score, the truth and the figures.

    Raises:
        InputError: the file is not a sealed truth, or not that of these findings.
    """
    from dashred.core.findings.schema import Score
    from dashred.evaluation.twins.cause_scoring import score_cause, score_region
    from dashred.evaluation.twins.findings_reader import read_findings
    from dashred.evaluation.twins.scoring import (
        FORECASTS,
        METHODS,
        latent_ranks,
        rmse,
        rmse_by_time,
        scaled_errors,
        score_law,
    )
    from dashred.evaluation.twins.sealing import open_seal
    from dashred.evaluation.twins.truth_figures import draw_truth

    findings = read_findings(output)
    frozen = json.loads((output / "freeze.json").read_text(encoding="utf-8"))["files"]
    truth, fields = open_seal(sealed)
    hidden = truth.concealed
    exact, coefficient_error = score_law(findings, truth.terms, hidden.parameters)
    field_errors: dict[str, np.ndarray] = {}
    figures: list[Path] = []
    if "estimates.nc" in frozen:
        estimates = load_fields(output / "estimates.nc")
        true = true_states(estimates, truth, fields, sealed)
        field_errors = scaled_errors(estimates, true, fields)
        errors = {method: rmse_by_time(error) for method, error in field_errors.items()}
        units = findings.get("units", {})
        tracked = _tracked_front(findings)
        figures = draw_truth(output, estimates, true, fields, errors, tracked, units)
    forecast_errors: dict[str, np.ndarray] = {}
    if "forecast.nc" in frozen:
        forecast = load_fields(output / "forecast.nc")
        if float(forecast["time"].min()) <= truth.duration:
            raise ValueError("forecast.nc reaches into the recording")
        forecast_errors = scaled_errors(
            forecast, true_states(forecast, truth, fields, sealed), fields
        )
    score = Score(
        exact_support=exact,
        coefficient_error=coefficient_error,
        region=score_region(findings, truth.terms),
        cause_right=score_cause(findings, bool(truth.terms), hidden),
        field_rmse=dict.fromkeys(METHODS) | {m: rmse(error) for m, error in field_errors.items()},
        field_rmse_by_field={
            field: {m: rmse(error[:, i]) for m, error in field_errors.items()}
            for i, field in enumerate(fields)
        },
        forecast=with_deprecated(
            {m: rmse(forecast_errors[m]) if m in forecast_errors else None for m in FORECASTS}
        ),
        latent_rank=latent_ranks(findings, truth.terms),
    )
    return score, truth, figures


def load_fields(path: Path) -> xr.Dataset:
    """Read fields by the current names of the methods, dimensions ``(method, time, *axes)``."""
    import xarray as xr

    with xr.open_dataset(path, engine="h5netcdf") as dataset:
        loaded = dataset.load()
    names = [DEPRECATED.get(name, name) for name in loaded["method"].values.tolist()]
    return loaded.assign_coords(method=names)


def true_states(
    estimates: xr.Dataset, truth: Truth, fields: tuple[str, ...], sealed: Path
) -> np.ndarray:
    """Return the true states at the estimates' times, ``(time, field, *grid)``.

    Raises:
        InputError: the truth belongs to another recording or another system.
    """
    import numpy as np

    times, clock = estimates["time"].values, truth.times.numpy()
    at = np.minimum(np.searchsorted(clock, times - TIME_TOLERANCE), len(clock) - 1)
    true: np.ndarray = truth.states.numpy()[at]
    same_shape = set(fields) == set(estimates.data_vars) and true.shape[2:] == tuple(
        size for dim, size in estimates.sizes.items() if dim not in ("method", "time")
    )
    if not same_shape or np.abs(clock[at] - times).max() > TIME_TOLERANCE:
        raise InputError(
            "this truth belongs to another recording or another system",
            where=str(sealed),
            hint="give the sealed.nc that was written with the recording",
        )
    return true


def _tracked_front(findings: Mapping[str, Any]) -> tuple[str, float] | None:
    """Return the field whose front is tracked and the length of the periodic axis; None without."""
    from dashred.evaluation.twins.scoring import system_of

    front = findings["input"]["config"]["system"]["front"]
    return None if front is None else (front, system_of(findings).axes[0].length)


def _print_score(score: Score) -> None:
    print("\nThe seal has been opened.", end=" ")
    if score["exact_support"] is not None:
        error = score["coefficient_error"]
        within = f", with coefficients within {error:.1%}".replace("%", " %") if error else ""
        print(f"The law found is {'' if score['exact_support'] else 'not '}the true law{within}.")
    if score["cause_right"] is not None:
        print(f"The verdict {'names' if score['cause_right'] else 'does not name'} a true cause.")
    for name, value in (score["region"] or {}).items():
        if value is not None:
            print(f"{REGIONS[name]} {value:.3g}.")
    field_errors = {m: v for m, v in score["field_rmse"].items() if v is not None}
    if not field_errors:
        print("There is no estimate of the field to compare with the truth.")
    else:
        print("Field RMSE against the hidden truth, in standard deviations:")
    _print_errors(field_errors)
    forecast = current_names(score["forecast"])
    forecast_errors = {name: v for name, v in forecast.items() if v is not None}
    if forecast_errors:
        print("Forecast RMSE after the end of the recording, in standard deviations:")
    _print_errors(forecast_errors)
    for name, ranks in score["latent_rank"].items():
        for term, rank in ranks.items():
            print(f"  {name}: true term {term} ranked {rank}")


def _print_errors(errors: dict[str, float]) -> None:
    width = max(12, *map(len, errors)) if errors else 0
    for name, value in errors.items():
        print(f"  {name:<{width}} {value:.3f}")


def metrics(score: Score) -> dict[str, float]:
    """Return the scores that are not null, by their MLflow name; exact support is 0 or 1."""
    found: dict[str, float | None] = {
        "exact_support": score["exact_support"],
        "coefficient_error": score["coefficient_error"],
        **score["field_rmse"],
        **{f"forecast/{name}": value for name, value in score["forecast"].items()},
    }
    return {f"score/{key}": float(v) for key, v in found.items() if v is not None}


def _log(
    root: str, experiment: str, run_id: str, score: Score, truth: Truth, files: list[Path]
) -> None:
    from dashred.core.mlflow.tracker import Tracker

    with Tracker.open(root, experiment, "", run_id) as run:
        run.log_metrics(metrics(score), 0)
        run.set_tags({"twin": truth.twin})
        run.log_files(path for path in files if path.is_file())
