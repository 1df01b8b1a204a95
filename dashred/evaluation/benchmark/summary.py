"""Summaries of the rows of one system and one noise."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from statistics import median
from typing import Any

from dashred.evaluation.benchmark.record import RATIOS, Record

Summary = dict[str, Any]

SETTING = ("system", "noise", "sensors", "extra")


def summarise(records: Sequence[Record]) -> list[Summary]:
    """Return one summary for each system, noise and layout, in order of appearance."""
    groups: dict[tuple[Any, ...], list[Record]] = {}
    for record in records:
        groups.setdefault(tuple(record.get(key) for key in SETTING), []).append(record)
    return [
        {**dict(zip(SETTING, setting, strict=True)), **_numbers(group)}
        for setting, group in groups.items()
    ]


def setting_text(summary: Summary) -> str:
    """Return the common settings of the rows of a summary: ``noise 0.05, 8 sensors``."""
    parts = [f"noise {summary['noise']:g}"]
    parts += [f"{summary['sensors']} sensors"] if summary["sensors"] is not None else []
    parts += [f"{summary['extra']} extra"] if summary["extra"] is not None else []
    return ", ".join(parts)


def _numbers(records: Sequence[Record]) -> Summary:
    ended = [record for record in records if record["problem"] is None]
    exact = [record for record in ended if record["exact_support"] is True]
    wrong = [record for record in ended if record["exact_support"] is False]
    # Rows without a hidden law are counted, but their trivial coefficient errors and ratios are
    # excluded from the medians.
    hiding = [record for record in ended if record["law"]]
    return {
        "rows": len(records),
        "failed": len(records) - len(ended),
        "exact": len(exact),
        "exact_unflagged": sum(not record["flagged"] for record in exact),
        "wrong_unflagged": sum(not record["flagged"] for record in wrong),
        "right_flagged": sum(record["flagged"] for record in exact),
        "not_converged": sum(record["verdict"] == "not-converged" for record in ended),
        "unanswered": len(ended) - len(exact) - len(wrong),
        "coefficient_error": spread(r["coefficient_error"] for r in exact if r["law"]),
        "ratios": {name: spread(record["ratios"][name] for record in hiding) for name in RATIOS},
        "seconds": spread(record["seconds"].get("in all") for record in ended),
    }


def spread(values: Iterable[float | None]) -> dict[str, float | None]:
    """Return the median and the largest of the known values."""
    known = [value for value in values if value is not None]
    if not known:
        return {"median": None, "worst": None}
    return {"median": median(known), "worst": max(known)}


def commits(records: Iterable[Record]) -> list[str]:
    """Return the distinct commits of the code that ran the rows."""
    return sorted({str(record["git_commit"]) for record in records if record.get("git_commit")})


def as_metrics(summaries: Iterable[Summary]) -> dict[str, float]:
    """Return the known numbers of the summaries by name: ``rde/noise 0.05/exact``."""
    flat: dict[str, float] = {}
    for summary in summaries:
        _flatten(
            f"{_plain(summary['system'])}/{setting_text(summary).replace(', ', '/')}",
            {key: value for key, value in summary.items() if key not in SETTING},
            flat,
        )
    return flat


def _flatten(prefix: str, tree: dict[str, Any], flat: dict[str, float]) -> None:
    for key, value in tree.items():
        name = f"{prefix}/{key.replace('/', ' over ')}"
        if isinstance(value, dict):
            _flatten(name, value, flat)
        elif value is not None:
            flat[name] = float(value)


def _plain(name: str) -> str:
    """Replace the characters that MLflow does not allow in the name of a metric."""
    return "".join(letter if letter.isascii() and letter.isalnum() else "_" for letter in name)
