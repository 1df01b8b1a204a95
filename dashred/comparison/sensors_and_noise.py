"""How much few sensors and much noise cost: a table a system, as the paper varies p and q."""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence

from dashred.benchmark.table import Grid
from dashred.comparison.outcomes import count_claims
from dashred.comparison.ratios import ComparedRow, FieldRatio, field_ratio

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
    """Return how many verdicts are right, how many wrong ones are not flagged, and RMSE ratios."""
    if not rows:
        return ""
    claims = count_claims(rows)
    parts = [f"right {claims.exact + claims.told} of {len(rows)}"]
    parts += [f"listed {claims.listed}"] if claims.listed else []
    parts += [f"wrong and unflagged {claims.wrong_unflagged}"] if claims.wrong_unflagged else []
    parts += [f"failed {claims.failed}"] if claims.failed else []
    for method, name in (("dashred", "DA-SHRED"), ("corrected", "corrected")):
        if ratio := ratio_text(field_ratio(rows, method)):
            parts.append(f"{name} × {ratio}")
    return "; ".join(parts)


def ratio_text(ratio: FieldRatio | None) -> str:
    """Return a median ratio, and how many rows the method has lost."""
    if ratio is None:
        return ""
    known = ratio.median is not None and math.isfinite(ratio.median)
    return " ".join([*([f"{ratio.median:.3g}"] if known else []), *lost_text(ratio)])


def lost_text(ratio: FieldRatio) -> list[str]:
    """Return how many rows the method has lost; nothing where it has none."""
    return [f"(lost {ratio.lost} of {ratio.rows})"] if ratio.lost else []
