"""What the proof shows, as a page: `docs/proof.md`."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from statistics import mean, median
from typing import Any

from dashred.core.files.atomic import write_text_atomic
from dashred.core.templates import render
from dashred.evaluation.proof.cases.case_record import KINDS, CaseRecord, name_of
from dashred.evaluation.proof.figures import FIGURES, WINDOWS, reliability
from dashred.evaluation.proof.protocol import ProtocolFacts, protocol
from dashred.evaluation.proof.scoring import outcomes
from dashred.evaluation.proof.scoring.statistics import Rate, percent
from dashred.evaluation.proof.scoring.targets import (
    POOLS,
    TARGETS,
    Measured,
    Records,
    Target,
    cases,
    coefficients,
    coverage,
    nulls,
    of_kind,
)

TEMPLATE = "evaluation/proof/templates/proof.md.j2"
Line = list[str]


def write_document(
    records: Records, path: Path, protocol_facts: ProtocolFacts, appendix: str = ""
) -> None:
    """Write the page, whole or not at all; its figures are looked for in `figures` beside it."""
    page = "\n".join(filter(None, [document(records, protocol_facts), appendix]))
    write_text_atomic(path, page)


def document(records: Records, facts: ProtocolFacts) -> str:
    """Return the page."""
    return render(
        TEMPLATE,
        outcomes=[target.outcome(target.measure(records)) for target in TARGETS],
        targets=[_target(target, target.measure(records)) for target in TARGETS],
        classes=_classes(records),
        calibration=_calibration(records),
        failed_cases=_failures(cases(records)),
        failed_nulls=_failures(nulls(records)),
        seconds=_seconds(records),
        captions={name: figure.caption for name, figure in FIGURES.items()},
        **protocol(facts, len(records)),
    )


def _target(target: Target, measured: Measured) -> Line:
    name = f"{target.name} ({measured.note})" if measured.note else target.name
    said = "" if measured.number is None else _number(measured.number, target)
    interval = measured.value.interval if isinstance(measured.value, Rate) else ""
    return [name, said, str(measured.n), interval, _aim(target), target.outcome(measured)]


def _number(number: float, target: Target) -> str:
    return (percent(number) if target.unit == " %" else f"{number:.3g}") + target.unit


def _aim(target: Target) -> str:
    if target.low == 1.0 and target.unit == " %":
        return "all"
    if target.low is not None and target.high is not None:
        return f"{percent(target.low)}-{_number(target.high, target)}"
    if target.low is not None:
        return f"≥ {_number(target.low, target)}"
    return "" if target.high is None else f"≤ {_number(target.high, target)}"


def _classes(records: Records) -> list[Line]:
    groups = {name: of_kind(records, kind) for kind, name in KINDS.items()}
    groups |= {f"pooled: {name}": of_kind(records, *kinds) for name, kinds in POOLS.items()}
    for system in sorted({record["system"] for record in cases(records)}):
        groups[f"system: {system}"] = [r for r in cases(records) if r["system"] == system]
    groups |= {"all cases": cases(records), "nulls, apart": nulls(records)}
    return [_class(name, chosen) for name, chosen in groups.items() if chosen]


def _class(name: str, records: Records) -> Line:
    rates = (
        Rate.of(record["right"] for record in records),
        Rate.of(record["listed"] for record in records),
        Rate.of(record["exact"] for record in records),
        Rate.of(map(outcomes.decidable, records)),
        Rate.of(map(outcomes.wrong_unflagged, records)),
    )
    return [name, str(len(records)), *map(str, rates)]


def _calibration(records: Records) -> list[Line]:
    lines = []
    for low, high, stated, right in reliability(records):
        name = f"leading cause, stated with {low:g} to {high:g}"
        lines.append(_share(name, right, f"{percent(stated)} %, as stated on average"))
    for window, (name, _) in WINDOWS.items():
        mine = [found for found in coefficients(records) if found["window"] == window]
        z = [value for found in mine if (value := outcomes.deviation(found)) is not None]
        rms = f"; rms of z: {mean(value**2 for value in z) ** 0.5:.2g}" if z else ""
        lines.append(_share(f"95 % intervals, terms {name}{rms}", coverage(mine), "95 %"))
    alarms = Rate.of(map(outcomes.false_alarm, nulls(records)))
    lines.append(_share("false alarms on nulls", alarms, "0 %"))
    return lines


def _share(name: str, rate: Rate, ideal: str) -> Line:
    said = f"{percent(rate.share)} %" if rate.n else ""
    return [name, said, str(rate.n), rate.interval, ideal]


def _failures(records: Records) -> dict[str, Any]:
    """Return how many there are, and a line for each that failed."""
    failed = [(record, said) for record in records if (said := outcomes.failings(record))]
    return {"n": len(records), "lines": [_failure(record, said) for record, said in failed]}


def _failure(record: CaseRecord, said: Sequence[str]) -> Line:
    about = [record["system"], KINDS[record["kind"]], f"noise {100 * record['noise']:.2g} %"]
    about.append(f"{record['sensors']} sensors")
    if record["mismatch"] is not None:
        about.append(f"effect {record['mismatch']:.2g} σ")
    if outcomes.decidable(record) is False:
        about.append("not decidable")
    told = record["told"]
    if record["probability"] is not None:
        told += f" (leading cause: {record['causes'][0]}, {record['probability']:.2g})"
    case = f"{name_of(record)}: {', '.join(about)}"
    return [case, record["hidden"], told, "; ".join(said)]


def _seconds(records: Records) -> list[Line]:
    lines = []
    for system in sorted({record["system"] for record in records}):
        for group in (cases(records), nulls(records)):
            mine = [record for record in group if record["system"] == system]
            known = [record["seconds"] for record in mine if record["seconds"] is not None]
            if known:
                name = f"{system}, {mine[0]['group']}"
                figures = (mean(known), median(known), max(known), sum(known) / 3600)
                lines.append([name, str(len(known)), *(f"{value:.3g}" for value in figures)])
    return lines
