"""Open the seal and score frozen findings: ``python -m dashred.score findings=DIR sealed=FILE``.

The only code that can read a hidden truth. It refuses findings that are not frozen, or were
touched since.
"""

from __future__ import annotations

import json
import sys
from pathlib import Path
from typing import TYPE_CHECKING, Any

from dashred.errors import InputError, run_entry
from dashred.findings import check_freeze, write_json_atomic

if TYPE_CHECKING:
    import numpy as np

    from dashred.sealing import Truth

KEYS = ("findings", "sealed", "root", "experiment", "run")
# Clocks that differ by more than this are not the same, in the unit of time.
CLOCK = 1e-9
METHODS = (
    "simulation",
    "simulation_same_start",
    "simulation_refit",
    "shred",
    "dashred",
    "corrected",
    "corrected_shred",
)


def main(argv: list[str]) -> int:
    """Score one run; with ``root``, ``experiment`` and ``run``, log it to MLflow too."""
    words = dict(word.partition("=")[::2] for word in argv)
    if not {"findings", "sealed"} <= words.keys() <= set(KEYS):
        raise InputError(
            "findings=DIR and sealed=FILE are needed",
            where="command line",
            hint=f"known words: {', '.join(KEYS)}",
        )
    output = Path(words["findings"])
    check_freeze(output)
    score, truth = score_findings(output, Path(words["sealed"]))
    write_json_atomic(output / "score.json", score)
    _print(score)
    if "run" in words:
        _log(words, output, score, truth)
    return 0


def score_findings(output: Path, sealed: Path) -> tuple[dict[str, Any], Truth]:
    """Compare the frozen estimates with the truth, draw the comparison, return ``score.json``.

    ``field_rmse``: each field divided by its own std over the fit window, then the RMSE over all.

    Raises:
        InputError: the sealed file is no truth, or not that of these findings.
    """
    import numpy as np
    import xarray as xr

    from dashred.sealing import open_seal

    findings = json.loads((output / "findings.json").read_text(encoding="utf-8"))
    frozen = json.loads((output / "freeze.json").read_text(encoding="utf-8"))["files"]
    truth, fields = open_seal(sealed)
    rmse: dict[str, float | None] = dict.fromkeys(METHODS)
    if "estimates.nc" in frozen:
        with xr.open_dataset(output / "estimates.nc", engine="h5netcdf") as estimates:
            estimates.load()
        real = _truth_of(estimates, truth, fields, sealed)
        std = real.swapaxes(0, 1).reshape(len(fields), -1).std(axis=1)
        errors = {}
        for method in estimates["method"].values.tolist():
            found = np.stack([estimates[f].sel({"method": method}).values for f in fields], axis=1)
            scaled = (found - real) / std.reshape(-1, *(1,) * (real.ndim - 2))
            rmse[method] = float(np.sqrt(np.mean(scaled**2)))
            errors[method] = np.sqrt(np.mean(scaled**2, axis=tuple(range(1, scaled.ndim))))
        _draw(output, estimates, truth, fields, errors)
    return {
        "exact_support": None,
        "coefficient_error": None,
        "field_rmse": rmse,
        "forecast": {"before": None, "after": None},
        "latent_rank": _ranks(findings, truth),
    }, truth


def _truth_of(estimates: Any, truth: Truth, fields: tuple[str, ...], sealed: Path) -> np.ndarray:
    """Return the true states at the estimates' times, ``(time, field, *grid)``."""
    times = estimates["time"].values
    real = truth.states[: len(times)].numpy()
    alike = set(fields) == set(estimates.data_vars) and real.shape[2:] == tuple(
        size for dim, size in estimates.sizes.items() if dim not in ("method", "time")
    )
    clock = truth.times[: len(times)].numpy()
    if not alike or clock.shape != times.shape or abs(clock - times).max() > CLOCK:
        raise InputError(
            "this is the truth of another recording or another system",
            where=str(sealed),
            hint="give the sealed.nc that was written beside the recording",
        )
    return real


def _ranks(findings: dict[str, Any], truth: Truth) -> dict[str, dict[str, int | None]]:
    """Return where each algorithm ranked the terms of the true law."""
    ranks: dict[str, dict[str, int | None]] = {}
    for name, latent in findings["latent"].items():
        if latent is not None:
            found = {(p["equation"], p["term"]): p["rank"] for p in latent["proposals"]}
            ranks[name] = {
                f"{t.equation}: {t.term}": found.get((t.equation, t.term)) for t in truth.terms
            }
    return ranks


def _draw(
    output: Path, estimates: Any, truth: Truth, fields: tuple[str, ...], errors: dict[str, Any]
) -> None:
    from dashred.reporting.figures import rmse_against_time, save_figure, space_time_panels

    times = estimates["time"].values
    label = "field RMSE / standard deviation"
    figure = rmse_against_time(times, errors, float(times[-1]), label)
    save_figure(figure, output / "rmse_against_time.png")
    axes = [str(dim) for dim in estimates[fields[0]].dims if dim not in ("method", "time")]
    if len(axes) != 1:
        return
    panels = {
        field: {
            "truth": truth.states[: len(times), i].numpy(),
            **{m: estimates[field].sel({"method": m}).values for m in errors},
        }
        for i, field in enumerate(fields)
    }
    x = estimates[axes[0]].values
    nowhere: dict[str, list[float]] = {field: [] for field in fields}
    figure = space_time_panels(times, axes[0], x, panels, nowhere)
    save_figure(figure, output / "space_time_truth.png")


def _print(score: dict[str, Any]) -> None:
    known = {m: v for m, v in score["field_rmse"].items() if v is not None}
    if not known:
        print("\nThe seal is opened, but there is no estimate of the field to compare with it.")
        return
    print("\nThe seal is opened. Whole field against the hidden truth, RMSE in std:")
    for method, value in known.items():
        print(f"  {method:<12} {value:.3f}")
    for name, ranks in score["latent_rank"].items():
        for term, rank in ranks.items():
            print(f"  {name}: true term {term} ranked {rank}")


def _log(words: dict[str, str], output: Path, score: dict[str, Any], truth: Truth) -> None:
    from dashred.tracking import Tracker

    with Tracker.open(words["root"], words["experiment"], "", words["run"]) as run:
        known = {m: v for m, v in score["field_rmse"].items() if v is not None}
        run.log_metrics({f"score/{m}": v for m, v in known.items()}, 0)
        run.set_tags({"twin": truth.twin})
        run.log_folder(output)


if __name__ == "__main__":
    sys.exit(run_entry(main))
