"""How much few sensors and much noise cost: a table a system, as the paper varies p and q."""

from __future__ import annotations

from collections.abc import Iterator, Sequence

from dashred.benchmark.table import Grid
from dashred.comparison.ratios import ComparedRow, median_ratio

# p, of SHRED's input, and q, that assimilation alone reads.
LAYOUT = "fit sensors, of them extra"


def sensors_and_noise(rows: Sequence[ComparedRow]) -> Iterator[Grid]:
    """Yield the table of every system whose sensors were varied."""
    varied = [r for r in rows if (r.record["sensors"], r.record["extra"]) != (None, None)]
    for system in dict.fromkeys(row.record["system"] for row in varied):
        mine = [row for row in varied if row.record["system"] == system]
        noises = list(dict.fromkeys(row.record["noise"] for row in mine))
        lines = []
        for layout in dict.fromkeys(map(_layout, mine)):
            alike = [row for row in mine if _layout(row) == layout]
            cells = [_cell([r for r in alike if r.record["noise"] == noise]) for noise in noises]
            lines.append([layout, *cells])
        header = [LAYOUT, *(f"{100 * noise:g} % noise" for noise in noises)]
        yield Grid(f"{system}: sensors and noise", header, lines)


def _layout(row: ComparedRow) -> str:
    sensors, extra = row.record["sensors"], row.record["extra"]
    return ", ".join(["own" if n is None else str(n) for n in (sensors, extra)])


def _cell(rows: Sequence[ComparedRow]) -> str:
    """Return how many laws are exact, how many wrong ones are not flagged, and RMSE ratios."""
    if not rows:
        return ""
    exact = sum(bool(row.record["exact_support"]) for row in rows)
    unflagged = sum(not r.record["exact_support"] and not r.record["flagged"] for r in rows)
    parts = [f"exact {exact} of {len(rows)}"]
    parts += [f"wrong and unflagged {unflagged}"] if unflagged else []
    for method, name in (("dashred", "DA-SHRED"), ("corrected", "corrected")):
        ratio = median_ratio(rows, method)
        parts += [f"{name} × {ratio:.3g}"] if ratio is not None else []
    return "; ".join(parts)
