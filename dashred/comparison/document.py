"""The page of a comparison: ``docs/results.md``."""

from __future__ import annotations

import shutil
from collections.abc import Iterable, Iterator, Sequence
from pathlib import Path

from dashred.benchmark.summary import commits, spread
from dashred.benchmark.table import Grid, markdown_grid, rows_grid
from dashred.comparison.paper import PAPER
from dashred.comparison.ratios import (
    FIELDS,
    LAWS,
    REFERENCE,
    ComparedRow,
    count_laws,
    groups,
    median_ratio,
    own_layout,
)
from dashred.comparison.sensors_and_noise import sensors_and_noise
from dashred.whole_files import write_text_atomic

FIGURES = {
    "space_time_truth.png": "truth and methods",
    "snapshots_truth.png": "truth and methods",
    "state_truth.png": "truth and methods",
    "front_truth.png": "place and width of the front",
    "rmse_against_time.png": "error against time",
}
# What run.json calls the seconds of one step of the corrected surrogate.
STEP = "one step of the corrected SHRED"

INTRODUCTION = (
    "Every number here is of twins: a truth that the analysis does not have, run at doubled "
    "resolution from a start of its own, is read by a few noisy sensors; the analysis gets these "
    "readings alone. The seal is opened when all methods have written what they found. The paper "
    "is Bao & Kutz, *Data assimilation and discrepancy modeling with shallow recurrent decoders* "
    "(2025), whose code trains on the real full field."
)
PAPER_NOTE = (
    "Error falls: the field's RMSE of the simulator as it is over that of the corrected one, the "
    "median over twins that hide a law. Seconds: of a run, learning included. Step: of the "
    "corrected SHRED, from a window of readings to the whole field, on one core."
)
FIELD_NOTE = (
    f"RMSE of the whole field over the fit window, over that of the {FIELDS[REFERENCE]} (the "
    "simulator as it is, begun where the law's fit begins); the median over twins that hide a "
    "law, and seeds. Below 1 is better than the simulation."
)
LAW_NOTE = (
    "Exact: rows in which all true terms were found and no others, of those in which the method "
    "looked for a law. Then terms, over all rows, nulls among them. Error: median over rows of the "
    "worst relative error of the true terms found. Latent SINDy's terms are those with a "
    "coefficient that is not zero; the filter's those whose 95 % interval excludes zero. PDE-FIND "
    "is given what nobody has, the full field, with the same noise at every point: an upper bound."
)


def write_results(rows: Sequence[ComparedRow], path: Path) -> None:
    """Write the page, whole or not at all, and its figures in ``figures`` beside it."""
    page = "\n\n".join(_page(rows, path.parent / "figures")) + "\n"
    write_text_atomic(path, page)


def _page(rows: Sequence[ComparedRow], figures: Path) -> Iterator[str]:
    yield "# Every system of the paper, against the paper"
    yield INTRODUCTION
    own = own_layout(rows)
    yield markdown_grid(_against_the_paper(own))
    yield PAPER_NOTE
    noises = list(dict.fromkeys(row.record["noise"] for row in own))
    for noise in noises:
        yield markdown_grid(_fields([row for row in own if row.record["noise"] == noise], noise))
    yield FIELD_NOTE
    for noise in noises:
        yield markdown_grid(_laws([row for row in own if row.record["noise"] == noise], noise))
    yield LAW_NOTE
    yield from map(markdown_grid, sensors_and_noise(rows))
    yield markdown_grid(rows_grid([row.record for row in rows]))
    yield "## Figures"
    yield from _figures(rows, figures)
    yield f"Code: {', '.join(commits(row.record for row in rows))}."


def _against_the_paper(rows: Sequence[ComparedRow]) -> Grid:
    header = [
        *("system", "noise", "the paper hides", "the paper finds", "the paper's gain"),
        *("dashred: exact law", "coefficient error", "error falls", "seconds", "step, ms"),
    ]
    lines = []
    for (system, noise), group in groups(rows).items():
        claim = PAPER.get(system)
        exact = [row for row in group if row.record["exact_support"]]
        error = spread(row.record["coefficient_error"] for row in exact if row.record["law"])
        ratio = median_ratio(group, "corrected")
        seconds = spread(row.record["seconds"].get("in all") for row in group)
        step = spread(row.record["seconds"].get(STEP) for row in group)
        lines.append(
            [
                system,
                f"{noise:.0%}".replace("%", " %"),
                *(claim or ("not in the paper", "", "")),
                f"{len(exact)} of {len(group)}",
                _share(error["median"]),
                "" if ratio is None else f"{1 / ratio:.3g}×",
                "" if seconds["median"] is None else f"{seconds['median']:.0f}",
                "" if step["median"] is None else f"{1e3 * step['median']:.2g}",
            ]
        )
    return Grid("The paper, and dashred from sensors alone", header, lines)


def _fields(rows: Sequence[ComparedRow], noise: float) -> Grid:
    systems = list(dict.fromkeys(row.record["system"] for row in rows))
    lines = []
    for method, name in FIELDS.items():
        ratios = [
            median_ratio([row for row in rows if row.record["system"] == system], method)
            for system in systems
        ]
        lines.append([name, *("" if ratio is None else f"{ratio:.3g}" for ratio in ratios)])
    return Grid(f"The field, at {100 * noise:g} % noise", ["", *systems], lines)


def _laws(rows: Sequence[ComparedRow], noise: float) -> Grid:
    lines = []
    for method, name in LAWS.items():
        count = count_laws(rows, method)
        if count is not None:
            numbers = (count.found, count.spurious, count.missed)
            exact = f"{count.exact} of {count.rows}"
            lines.append([name, exact, *map(str, numbers), _share(count.error)])
    header = ("", "exact", "found", "spurious", "missed", "error")
    return Grid(f"The law, at {100 * noise:g} % noise", header, lines)


def _figures(rows: Sequence[ComparedRow], folder: Path) -> Iterator[str]:
    """Copy the picture of each system's first row that hides a law."""
    folder.mkdir(parents=True, exist_ok=True)
    for system, row in _first(rows):
        yield f"**{system}**, twin {row.record['twin']}, noise {row.record['noise']:g}"
        for name, shows in FIGURES.items():
            if (row.folder / name).is_file():
                target = folder / f"results_{system}_{name}"
                shutil.copyfile(row.folder / name, target)
                yield f"![{system}: {shows}]({folder.name}/{target.name})"


def _first(rows: Iterable[ComparedRow]) -> Iterator[tuple[str, ComparedRow]]:
    seen = set()
    for row in rows:
        system = row.record["system"]
        if system not in seen and row.record["law"]:
            seen.add(system)
            yield system, row


def _share(value: float | None) -> str:
    return "" if value is None else f"{100 * value:.2g} %"
