"""The tables of the page, each a list of lines of cells."""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterable, Sequence
from statistics import median
from typing import TypedDict

from dashred.evaluation.foreign.cases.case import COLLECTIONS, KINDS
from dashred.evaluation.foreign.peers.methods import GIVEN, PEERS
from dashred.evaluation.foreign.rows import Row
from dashred.evaluation.proof.scoring.statistics import Rate, median_of

Rows = Sequence[Row]
# Bins of the stated probability of the leading cause.
BINS = ((0.0, 0.9), (0.9, 0.98), (0.98, 1.01))


def overview(name: str, planned: int, rows: Rows) -> list[str]:
    """Return the line of a draw in the table of all draws."""
    shares = [
        str(_rate(chosen, "right")) if chosen else "–"
        for chosen in ([row for row in rows if row["collection"] == each] for each in COLLECTIONS)
    ]
    covered = Rate.of(c for row in rows for c in row["covered"])
    done = f"{len(rows)} of {planned}"
    return [name, done, *shares, str(_rate(rows, "silent-wrong")), str(covered)]


def outcome_table(rows: Rows) -> list[list[str]]:
    """Return the shares of the outcomes by collection, noise, kind and system."""
    return [
        [
            name,
            str(len(chosen)),
            str(_rate(chosen, "right")),
            str(_rate(chosen, "right", "listed")),
            *(str(_rate(chosen, each)) for each in ("listed", "flagged")),
            *(str(_rate(chosen, each)) for each in ("silent-wrong", "no-answer")),
        ]
        for name, chosen in _groups(rows)
    ]


def detail_table(rows: Rows) -> list[list[str]]:
    """Return what was measured beside the outcomes."""
    nulls, sensors = _of_kind(rows, "nothing"), _of_kind(rows, "sensor")
    answered = [row for row in nulls if row["verdict"] is not None]
    lines = [
        ["sources located: the peak is inside", _located(rows)],
        ["erring sensors named", str(_rate(sensors, "right"))],
        [
            "false alarms where nothing is hidden",
            str(Rate.of(row["outcome"] != "right" for row in answered)),
        ],
        ["95 % intervals that cover", str(Rate.of(c for row in rows for c in row["covered"]))],
    ]
    for low, high in BINS:
        stated = [row for row in rows if low <= _probability(row) < high]
        name = f"leading cause right, stated probability {low:g} to {min(high, 1):g}"
        lines.append([name, str(Rate.of(row["leading_right"] for row in stated))])
    right = [row for row in rows if row["outcome"] == "right" and row["kind"] != "nothing"]
    for name, values in (
        ("test sensors", [row["gain_sensors"] for row in right]),
        ("held-out time", [row["gain_time"] for row in right]),
        ("forecast from a fitted state", [row.get("gain_forecast") for row in right]),
    ):
        middle, count = median_of(values)
        better = Rate.of(None if value is None else value > 1 for value in values)
        lines.append(
            [
                f"gain, {name}, where the verdict is right: median of {count}, share above 1",
                "–" if middle is None else f"{middle:.3g}; {better}",
            ]
        )
    return lines


class PeerTable(TypedDict):
    """The methods that are given the same, and dashred on the same cases.

    Attributes:
        given: what they are given.
        header: cells of the header.
        lines: cells by line.
    """

    given: str
    header: list[str]
    lines: list[list[str]]


def peer_tables(rows: Rows) -> list[PeerTable]:
    """Return the shares of right answers of the methods, grouped by what they are given."""
    tables = []
    for given, title in GIVEN.items():
        names = [
            name
            for name, method in PEERS.items()
            if method.given == given and any(name in row["peers"] for row in rows)
        ]
        if names:
            header = ["", "n", "dashred", *(PEERS[name].title for name in names)]
            lines = [line for group in _groups(rows) for line in _peer_line(*group, names)]
            tables.append(PeerTable(given=title, header=header, lines=lines))
    return tables


def _peer_line(name: str, rows: Rows, methods: Sequence[str]) -> Iterable[list[str]]:
    """Yield the line of a group of rows, if any of the methods was asked about any."""
    asked = [row for row in rows if any(method in row["peers"] for method in methods)]
    if asked:
        answers = [[row["peers"][m] for row in asked if m in row["peers"]] for m in methods]
        shares = [str(Rate.of(peer["right"] is True for peer in each)) for each in answers]
        yield [name, str(len(asked)), str(_rate(asked, "right")), *shares]


def peer_problems(rows: Rows) -> list[list[str]]:
    """Return how many answers each method gave, and why it gave none, the commonest reason."""
    lines = []
    for name, method in PEERS.items():
        asked = [row["peers"][name] for row in rows if name in row["peers"]]
        problems = Counter(peer["problem"] for peer in asked if peer["problem"])
        if asked:
            reason = problems.most_common(1)[0][0] if problems else "–"
            seconds = median(peer["seconds"] for peer in asked)
            counts = [
                sum(peer["right"] is verdict for peer in asked) for verdict in (True, False, None)
            ]
            title = f"{method.title} ({GIVEN[method.given]})"
            lines.append([title, *map(str, counts), f"{seconds:.3g}", str(reason)])
    return lines


def peer_versions(rows: Rows) -> str:
    """Return the versions of the packages of the methods, as text."""
    found = {
        f"{package} {version}"
        for row in rows
        for peer in row["peers"].values()
        for package, version in peer.get("versions", {}).items()
    }
    return ", ".join(sorted(found))


def seconds_table(rows: Rows) -> list[list[str]]:
    """Return the seconds of the analyses by collection and system."""
    lines = []
    for name, chosen in _groups(rows):
        seconds = sorted(row["seconds"] for row in chosen if row["seconds"] is not None)
        if seconds:
            figures = (median(seconds), percentile(seconds, 0.95), seconds[-1])
            lines.append([name, str(len(seconds)), *(f"{value:.3g}" for value in figures)])
    return lines


def percentile(ordered: Sequence[float], share: float) -> float:
    """Return the smallest of ordered values that this share of them does not exceed."""
    position = -(-len(ordered) * share // 1)
    return ordered[max(0, int(position) - 1)]


def failure_table(rows: Rows) -> list[list[str]]:
    """Return a line for each case that is not right."""
    return [
        [row["case"], row["hidden"], row["problem"] or row["told"], row["outcome"]]
        for row in rows
        if row["outcome"] != "right"
    ]


def _groups(rows: Rows) -> Iterable[tuple[str, list[Row]]]:
    """Yield the groups of a table that have rows: collections, kinds, and fields by system."""
    groups: dict[str, list[Row]] = {}
    for collection, title in COLLECTIONS.items():
        for noise in sorted({row["noise"] for row in rows}):
            groups[f"{title}, {100 * noise:g} % noise"] = [
                row for row in rows if (row["collection"], row["noise"]) == (collection, noise)
            ]
    others = [row for row in rows if row["collection"] != "dysts"]
    ours = [row for row in others if row["collection"] != "published"]
    for kind, title in KINDS.items():
        groups[f"fields and mechanics: {title}"] = _of_kind(ours, kind)
    for system in sorted({row["system"] for row in others}):
        groups[f"system: {system}"] = [row for row in others if row["system"] == system]
    groups["all"] = list(rows)
    yield from ((name, chosen) for name, chosen in groups.items() if chosen)


def _rate(rows: Rows, *outcomes: str) -> Rate:
    return Rate.of(row["outcome"] in outcomes for row in rows)


def _probability(row: Row) -> float:
    return -1.0 if row["probability"] is None else row["probability"]


def _located(rows: Rows) -> str:
    return str(Rate.of(row["located"] or False for row in _of_kind(rows, "source")))


def _of_kind(rows: Rows, kind: str) -> list[Row]:
    return [row for row in rows if row["kind"] == kind]
