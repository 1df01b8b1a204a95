"""The document of a comparison, ``docs/results.md``."""

from __future__ import annotations

import math
import shutil
from collections.abc import Iterable, Iterator, Sequence
from pathlib import Path
from typing import Any

from dashred.core.files.atomic import write_text_atomic
from dashred.core.templates import render
from dashred.evaluation.benchmark.record import Record
from dashred.evaluation.benchmark.summary import commits, spread
from dashred.evaluation.benchmark.table import Grid, notes_on_code, rows_grid
from dashred.evaluation.comparison.outcomes import count_claims
from dashred.evaluation.comparison.paper import PAPER
from dashred.evaluation.comparison.ratios import (
    FIELDS,
    LAWS,
    REFERENCE,
    ComparedRow,
    FieldRatio,
    count_laws,
    field_ratio,
    groups,
    left_unchanged,
    median_seconds,
    own_layout,
)
from dashred.evaluation.comparison.sensors_and_noise import lost_text, ratio_text, sensors_and_noise

FIGURES = {
    "space_time_truth.png": "truth and methods",
    "snapshots_truth.png": "truth and methods",
    "state_truth.png": "truth and methods",
    "front_truth.png": "place and width of the front",
    "rmse_against_time.png": "error against time",
    "methods_truth.png": "error of every method against time",
    "sparsity.png": "accuracy against sparsity, of latent SINDy and of the law",
}
# Labels of all methods.
NAMES = FIELDS | LAWS
# Key in run.json of the seconds of one step of the corrected surrogate.
STEP = "one step of the corrected SHRED"


def write_results(rows: Sequence[ComparedRow], path: Path) -> None:
    """Write the document atomically, and its figures in ``figures`` next to it."""
    write_text_atomic(path, _page(rows, path))


def _page(rows: Sequence[ComparedRow], path: Path) -> str:
    scorers = {commit for row in rows if (commit := row.git_commit)}
    code = notes_on_code(sorted({*commits(row.record for row in rows), *scorers}))
    warnings = [note for note in code if note.startswith("Warning")]
    own = own_layout(rows)
    by_noise: dict[float, list[ComparedRow]] = {}
    for row in own:
        by_noise.setdefault(row.record["noise"], []).append(row)
    unchanged, asked = left_unchanged(own)
    return render(
        "evaluation/comparison/templates/results.md.j2",
        code={"warnings": warnings, "others": [note for note in code if note not in warnings]},
        paper=_against_the_paper(own),
        fields=[_fields(group, noise) for noise, group in by_noise.items()],
        reference=FIELDS[REFERENCE],
        unchanged=unchanged,
        asked=asked,
        laws=[_laws(group, noise) for noise, group in by_noise.items()],
        seconds=_seconds(own),
        layouts=list(sensors_and_noise(rows)),
        all_rows=rows_grid([row.record for row in rows]),
        failures=_failures(rows),
        figures=list(_figures(rows, path.parent / "figures", path.stem)),
    )


def _against_the_paper(rows: Sequence[ComparedRow]) -> Grid:
    header = [
        *("system", "noise", "the paper hides", "the paper finds", "error reduction in the paper"),
        *("dashred: exact law", "listed", "no law hidden: right", "wrong and unflagged", "failed"),
        *("coefficient error", "error reduction", "seconds", "step, ms"),
    ]
    lines = []
    for (system, noise), group in groups(rows).items():
        claims, ratio = count_claims(group), field_ratio(group, "corrected")
        records = [row.record for row in group]
        error = spread(r["coefficient_error"] for r in records if r["law"] and _exact(r))
        lines.append(
            [
                system,
                f"{100 * noise:g} %",
                *(PAPER.get(system) or ("not in the paper", "", "")),
                f"{claims.exact} of {claims.laws}" if claims.laws else "",
                str(claims.listed),
                f"{claims.right} of {claims.others}" if claims.others else "",
                str(claims.wrong_unflagged),
                str(claims.failed),
                _share(error["median"]),
                _gain(ratio),
                _rounded(spread(_stage_seconds(r, "in all") for r in records)["median"]),
                _milliseconds(spread(_stage_seconds(r, STEP) for r in records)["median"]),
            ]
        )
    return Grid("The paper, and dashred from sensors alone", header, lines)


def _gain(ratio: FieldRatio | None) -> str:
    """Return the factor of error reduction, and the number of lost rows."""
    if ratio is None:
        return ""
    known = bool(ratio.median) and math.isfinite(ratio.median or 0.0)
    parts = [f"{1 / (ratio.median or 1.0):.3g}×"] if known else []
    return " ".join([*parts, *lost_text(ratio)])


def _exact(record: Record) -> bool:
    return record["problem"] is None and record["exact_support"] is True


def _stage_seconds(record: Record, stage: str) -> float | None:
    """Return the seconds of a stage; None if the row did not reach it."""
    seconds = record["seconds"].get(stage) if record["problem"] is None else None
    return None if seconds is None else float(seconds)


def _fields(rows: Sequence[ComparedRow], noise: float) -> Grid:
    systems = _by_system(rows)
    ratios = {
        name: [ratio_text(field_ratio(group, method)) for group in systems.values()]
        for method, name in FIELDS.items()
    }
    # The rows of earlier versions have no errors of the methods that came later.
    lines = [[name, *texts] for name, texts in ratios.items() if any(texts)]
    return Grid(f"The field, at {100 * noise:g} % noise", ["", *systems], lines)


def _laws(rows: Sequence[ComparedRow], noise: float) -> Grid:
    lines = []
    for system, group in _by_system(rows).items():
        for method, name in LAWS.items():
            count = count_laws(group, method)
            if count is not None:
                numbers = (count.failed, count.found, count.spurious, count.missed)
                exact = f"{count.exact} of {count.rows}"
                lines.append([system, name, exact, *map(str, numbers), _share(count.error)])
    header = ("system", "", "exact", "failed", "found", "spurious", "missed", "error")
    return Grid(f"The law, at {100 * noise:g} % noise", header, lines)


def _seconds(rows: Sequence[ComparedRow]) -> Grid:
    systems = _by_system(rows)
    lines = []
    for method, name in NAMES.items():
        seconds = [median_seconds(group, method) for group in systems.values()]
        if any(value is not None for value in seconds):
            lines.append([name, *map(_rounded, seconds)])
    return Grid("Seconds", ["", *systems], lines)


def _by_system(rows: Sequence[ComparedRow]) -> dict[str, list[ComparedRow]]:
    systems: dict[str, list[ComparedRow]] = {}
    for row in rows:
        systems.setdefault(row.record["system"], []).append(row)
    return systems


def _failures(rows: Sequence[ComparedRow]) -> Grid:
    """Return a table of the rows and methods that failed."""
    lines = []
    for row in rows:
        record = row.record
        place = [record["system"], record["twin"], f"{record['noise']:g}", str(record["seed"])]
        if row.problem is not None:
            lines.append([*place, "all" if not row.methods else "the other methods", row.problem])
        else:
            for method, score in row.methods.items():
                if score["failed"] is not None:
                    lines.append([*place, NAMES[method], score["failed"]])
    header = ("system", "twin", "noise", "seed", "method", "cause")
    return Grid("Failures", header, lines)


def _figures(rows: Sequence[ComparedRow], folder: Path, page: str) -> Iterator[dict[str, Any]]:
    """Copy the figures of each system's first row with a hidden law, named after the document."""
    folder.mkdir(parents=True, exist_ok=True)
    for system, row in _first(rows):
        files = []
        for name, shows in FIGURES.items():
            if (row.folder / name).is_file():
                target = folder / f"{page}_{system}_{name}"
                shutil.copyfile(row.folder / name, target)
                files.append({"shows": shows, "path": f"{folder.name}/{target.name}"})
        record = row.record
        yield {
            "system": system,
            "twin": record["twin"],
            "noise": f"{record['noise']:g}",
            "files": files,
        }


def _first(rows: Iterable[ComparedRow]) -> Iterator[tuple[str, ComparedRow]]:
    done_systems = set()
    for row in rows:
        system = row.record["system"]
        if system not in done_systems and row.record["law"] and row.record["problem"] is None:
            done_systems.add(system)
            yield system, row


def _share(value: float | None) -> str:
    return "" if value is None else f"{100 * value:.2g} %"


def _rounded(value: float | None) -> str:
    return "" if value is None else f"{value:.0f}" if value >= 10 else f"{value:.2g}"


def _milliseconds(value: float | None) -> str:
    return "" if value is None else f"{1e3 * value:.2g}"
