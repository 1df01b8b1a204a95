"""The document of the proof, `docs/proof.md`."""

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
    """Write the document atomically; it links to figures in the folder `figures` next to it."""
    page = "\n".join(filter(None, [document(records, protocol_facts), appendix]))
    write_text_atomic(path, page)


def document(records: Records, facts: ProtocolFacts) -> str:
    """Return the document as Markdown."""
    return render(
        TEMPLATE,
        outcomes=[target.outcome(target.measure(records)) for target in TARGETS],
        targets=[_target(target, target.measure(records)) for target in TARGETS],
        classes=_classes(records),
        calibration=_calibration(records),
        failed_cases=_list_failures(cases(records)),
        failed_nulls=_list_failures(nulls(records)),
        seconds=_seconds(records),
        captions={name: figure.caption for name, figure in FIGURES.items()},
        **protocol(facts, len(records)),
    )


def _target(target: Target, measured: Measured) -> Line:
    name = f"{target.name} ({measured.note})" if measured.note else target.name
    value = "" if measured.number is None else _number(measured.number, target)
    interval = measured.value.interval if isinstance(measured.value, Rate) else ""
    return [name, value, str(measured.n), interval, _target_text(target), target.outcome(measured)]


def _number(number: float, target: Target) -> str:
    return (percent(number) if target.unit == " %" else f"{number:.3g}") + target.unit


def _target_text(target: Target) -> str:
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
    groups |= {"all cases": cases(records), "nulls, separately": nulls(records)}
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
        name = f"leading cause, probability {low:g} to {high:g}"
        lines.append(_calibration_row(name, right, f"{percent(stated)} %, the mean stated"))
    for window, (name, _) in WINDOWS.items():
        chosen = [found for found in coefficients(records) if found["window"] == window]
        z = [value for found in chosen if (value := outcomes.deviation(found)) is not None]
        rms = f"; rms of z: {mean(value**2 for value in z) ** 0.5:.2g}" if z else ""
        lines.append(
            _calibration_row(f"95 % intervals, terms {name}{rms}", coverage(chosen), "95 %")
        )
    alarms = Rate.of(map(outcomes.false_alarm, nulls(records)))
    lines.append(_calibration_row("false alarms on nulls", alarms, "0 %"))
    return lines


def _calibration_row(name: str, rate: Rate, ideal: str) -> Line:
    value = f"{percent(rate.share)} %" if rate.n else ""
    return [name, value, str(rate.n), rate.interval, ideal]


def _list_failures(records: Records) -> dict[str, Any]:
    """Return the number of records and a row for each with shortcomings."""
    failed = [(record, lacks) for record in records if (lacks := outcomes.shortcomings(record))]
    return {"n": len(records), "lines": [_failure(record, lacks) for record, lacks in failed]}


def _failure(record: CaseRecord, lacks: Sequence[str]) -> Line:
    details = [record["system"], KINDS[record["kind"]], f"noise {100 * record['noise']:.2g} %"]
    details.append(f"{record['sensors']} sensors")
    if record["mismatch"] is not None:
        details.append(f"effect {record['mismatch']:.2g} σ")
    if outcomes.decidable(record) is False:
        details.append("not decidable")
    findings = record["told"]
    if record["probability"] is not None:
        findings += f" (leading cause: {record['causes'][0]}, {record['probability']:.2g})"
    case = f"{name_of(record)}: {', '.join(details)}"
    return [case, record["hidden"], findings, "; ".join(lacks)]


def _seconds(records: Records) -> list[Line]:
    lines = []
    for system in sorted({record["system"] for record in records}):
        for group in (cases(records), nulls(records)):
            chosen = [record for record in group if record["system"] == system]
            known = [record["seconds"] for record in chosen if record["seconds"] is not None]
            if known:
                name = f"{system}, {chosen[0]['group']}"
                figures = (mean(known), median(known), max(known), sum(known) / 3600)
                lines.append([name, str(len(known)), *(f"{value:.3g}" for value in figures)])
    return lines
