"""Tables of scores by number of sensors and noise, for systems in which the sensors were varied."""

from __future__ import annotations

import json
import math
from collections.abc import Iterator, Sequence

from dashred.evaluation.benchmark.table import Grid
from dashred.evaluation.comparison.outcomes import count_claims
from dashred.evaluation.comparison.ratios import ComparedRow, FieldRatio, field_ratio

METHODS = {"shred": "SHRED", "dashred": "DA-SHRED", "corrected": "corrected"}
LAYOUT = ("p, read by SHRED", "q, further ones")


def sensors_and_noise(rows: Sequence[ComparedRow]) -> Iterator[Grid]:
    """Yield a table for each system in which the number of sensors was varied."""
    varied = [r for r in rows if (r.record["sensors"], r.record["extra"]) != (None, None)]
    for system in dict.fromkeys(row.record["system"] for row in varied):
        chosen = [row for row in varied if row.record["system"] == system]
        noises = list(dict.fromkeys(row.record["noise"] for row in chosen))
        lines = []
        layouts = [(_layout(row), row) for row in chosen]
        for layout in sorted({layout for layout, _ in layouts}, key=_layout_key):
            same_layout = [row for other, row in layouts if other == layout]
            cells = [
                _cell([r for r in same_layout if r.record["noise"] == noise]) for noise in noises
            ]
            lines.append([*layout, *cells])
        header = [*LAYOUT, *(f"{100 * noise:g} % noise" for noise in noises)]
        yield Grid(f"{system}: sensors and noise", header, lines)


def _layout(row: ComparedRow) -> tuple[str, str]:
    """Return p and q of the split of the analysis, or as requested if there are no findings."""
    findings = row.folder / "findings.json"
    if findings.is_file():
        splits = json.loads(findings.read_text(encoding="utf-8"))["input"]["splits"]
        return str(len(splits["inputs"])), str(len(splits["extra"]))
    sensors, extra = row.record["sensors"], row.record["extra"]
    known = sensors is not None and extra is not None
    return str(sensors - extra) if known else "own", "own" if extra is None else str(extra)


def _layout_key(layout: tuple[str, str]) -> tuple[int, ...]:
    return tuple(int(n) if n.isdigit() else -1 for n in layout)


def _cell(rows: Sequence[ComparedRow]) -> str:
    """Return the numbers of right and of wrong unflagged verdicts, and the RMSE ratios."""
    if not rows:
        return ""
    claims = count_claims(rows)
    parts = [f"right {claims.exact + claims.right} of {len(rows)}"]
    parts += [f"listed {claims.listed}"] if claims.listed else []
    parts += [f"wrong and unflagged {claims.wrong_unflagged}"] if claims.wrong_unflagged else []
    parts += [f"failed {claims.failed}"] if claims.failed else []
    # Without a law the corrected simulator equals the simulation, and a ratio of 1 is no result.
    with_law = any(row.record["problem"] is None and row.record["terms"] for row in rows)
    for method, name in METHODS.items():
        if method == "corrected" and not with_law:
            parts.append(f"{name} –")
        elif ratio := ratio_text(field_ratio(rows, method)):
            parts.append(f"{name} × {ratio}")
    return "; ".join(parts)


def ratio_text(ratio: FieldRatio | None) -> str:
    """Return the median ratio and the number of lost rows."""
    if ratio is None:
        return ""
    known = ratio.median is not None and math.isfinite(ratio.median)
    return " ".join([*([f"{ratio.median:.3g}"] if known else []), *lost_text(ratio)])


def lost_text(ratio: FieldRatio) -> list[str]:
    """Return the number of lost rows; empty if there are none."""
    return [f"(lost {ratio.lost} of {ratio.rows})"] if ratio.lost else []
