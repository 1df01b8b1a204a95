"""What the proof shows, as a page: `docs/proof.md`."""

from __future__ import annotations

import re
from collections.abc import Iterable, Iterator, Sequence
from pathlib import Path
from statistics import mean, median

from dashred.core.files.atomic import write_text_atomic
from dashred.evaluation.proof.cases.case_record import KINDS, CaseRecord, name_of
from dashred.evaluation.proof.figures import FIGURES, WINDOWS, reliability
from dashred.evaluation.proof.protocol import ProtocolFacts, protocol
from dashred.evaluation.proof.scoring import outcomes
from dashred.evaluation.proof.scoring.statistics import Rate, percent
from dashred.evaluation.proof.scoring.targets import (
    POOLS,
    TARGETS,
    Records,
    Target,
    cases,
    coefficients,
    coverage,
    nulls,
    of_kind,
)

JUDGED = (
    "A share is judged by itself; its interval is Wilson's, at 95 %. What has no meaning for a "
    "case leaves it out of that number: n tells how many count. What a case lacks that could have "
    "been found in it counts as missed: a region overlaps by 0, a law that was not found gains 1×. "
    "Classes of fewer than 30 cases are pooled."
)
CLASSED = (
    "Exact form: of the cases in which a law was looked for. Decidable: of those with an oracle. "
    "Wrong and unflagged: of those that did not die. In brackets: Wilson's 95 % interval."
)
CALIBRATED = (
    "Leading cause: how often it is of the true kind, by the probability stated for it. Intervals: "
    "how many of those told hold the true coefficient, of laws whose form is exact; z is the error "
    "in standard deviations as told, and its rms is 1 where these are right."
)


def write_document(
    records: Records, path: Path, protocol_facts: ProtocolFacts, appendix: str = ""
) -> None:
    """Write the page, whole or not at all; its figures are looked for in `figures` beside it."""
    page = "\n".join(filter(None, [document(records, protocol_facts), appendix]))
    write_text_atomic(path, page)


def document(records: Records, facts: ProtocolFacts) -> str:
    """Return the page."""
    parts = [
        "# The proof: effects that are concealed",
        _headline(records),
        "## Protocol",
        protocol(facts, len(records)),
        "## Targets",
        _targets(records),
        JUDGED,
        "## By class of what was hidden",
        _classes(records),
        CLASSED,
        _figure("proof_scores.png"),
        "## Calibration",
        _calibration(records),
        CALIBRATED,
        _figure("proof_reliability.png"),
        _figure("proof_coverage.png"),
        "## Gains",
        _figure("proof_gains.png"),
        "## Every failure",
        *_failures("cases", cases(records)),
        *_failures("nulls", nulls(records)),
        "## Seconds",
        _seconds(records),
    ]
    return "\n\n".join(parts) + "\n"


def _headline(records: Records) -> str:
    told = [target.outcome(target.measure(records)) for target in TARGETS]
    counts = f"{told.count('met')} of {len(told)} targets are met, {told.count('not met')} missed"
    if empty := told.count("nothing to judge by"):
        counts += f", and {empty} have nothing to be judged by"
    return f"**{counts}.**"


def _targets(records: Records) -> str:
    lines = []
    for target in TARGETS:
        measured = target.measure(records)
        rate = measured.value if isinstance(measured.value, Rate) else None
        name = f"{target.name} ({measured.note})" if measured.note else target.name
        said = "" if measured.number is None else _number(measured.number, target)
        outcome = target.outcome(measured)
        interval = rate.interval if rate else ""
        lines.append([name, said, str(measured.n), interval, _aim(target), outcome])
    return _table(("", "measured", "n", "95 % interval", "target", "met?"), lines)


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


def _classes(records: Records) -> str:
    groups = {name: of_kind(records, kind) for kind, name in KINDS.items()}
    groups |= {name: of_kind(records, *kinds) for name, kinds in POOLS.items()}
    for system in sorted({record["system"] for record in cases(records)}):
        groups[f"system: {system}"] = [r for r in cases(records) if r["system"] == system]
    groups |= {"all cases": cases(records), "nulls, apart": nulls(records)}
    header = ("hidden", "n", "verdict right", "right or listed", "exact form", "decidable")
    lines = [_class(name, chosen) for name, chosen in groups.items() if chosen]
    return _table((*header, "wrong and unflagged"), lines)


def _class(name: str, records: Records) -> list[str]:
    rates = (
        Rate.of(record["right"] for record in records),
        Rate.of(record["listed"] for record in records),
        Rate.of(record["exact"] for record in records),
        Rate.of(map(outcomes.decidable, records)),
        Rate.of(map(outcomes.wrong_unflagged, records)),
    )
    return [name, str(len(records)), *map(str, rates)]


def _calibration(records: Records) -> str:
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
    return _table(("", "measured", "n", "95 % interval", "if all were right"), lines)


def _share(name: str, rate: Rate, ideal: str) -> list[str]:
    said = f"{percent(rate.share)} %" if rate.n else ""
    return [name, said, str(rate.n), rate.interval, ideal]


def _failures(group: str, records: Records) -> Iterator[str]:
    """Yield how many failed, and each of them with what was hidden and what the tool said."""
    failed = [(record, said) for record in records if (said := outcomes.failings(record))]
    yield f"{len(failed)} of {len(records)} {group} fall short in something."
    if failed:
        lines = [_failure(record, said) for record, said in failed]
        yield _table(("case", "what was hidden", "what the tool said", "what is wrong"), lines)


def _failure(record: CaseRecord, said: Sequence[str]) -> list[str]:
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


def _seconds(records: Records) -> str:
    lines = []
    for system in sorted({record["system"] for record in records}):
        for group in (cases(records), nulls(records)):
            mine = [record for record in group if record["system"] == system]
            known = [record["seconds"] for record in mine if record["seconds"] is not None]
            if known:
                name = f"{system}, {mine[0]['group']}"
                figures = (mean(known), median(known), max(known), sum(known) / 3600)
                lines.append([name, str(len(known)), *(f"{value:.3g}" for value in figures)])
    return _table(("", "n", "mean", "median", "longest", "hours in all"), lines)


def _figure(name: str) -> str:
    caption = FIGURES[name].caption
    return f"![{caption}](figures/{name})\n\n*{caption}*"


def _table(header: Sequence[str], lines: Iterable[Sequence[str]]) -> str:
    rows = [header, ["---"] * len(header), *([_escaped(cell) for cell in line] for line in lines)]
    return "\n".join(f"| {' | '.join(row)} |" for row in rows)


def _escaped(cell: str) -> str:
    """Keep what Markdown would read as a sign of its own, and each line of the table one line."""
    return re.sub(r"([\\|*_<`~\[])", r"\\\1", " ".join(cell.split()))
