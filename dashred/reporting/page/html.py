"""`report.html`: one page that holds all a reader needs, and refers to nothing outside it."""

from collections.abc import Mapping, Sequence
from html import escape
from pathlib import Path
from typing import Any

from dashred.core.files.atomic import write_text_atomic
from dashred.reporting.figures.figure_names import FORECAST, METHOD, PROOF, WHAT, WHERE
from dashred.reporting.page import sections
from dashred.reporting.page.parts import figures as drawn
from dashred.reporting.page.parts import paragraphs
from dashred.reporting.page.provenance import how_it_was_done, provenance
from dashred.reporting.page.style import PAPER, SCREEN
from dashred.reporting.text.headline import headline
from dashred.reporting.text.verdict import VERDICTS, causes, law


def write_html(
    path: Path,
    findings: Mapping[str, Any],
    figures: Mapping[str, Mapping[str, Path]],
    summary: str,
    mostly: Sequence[str] = (),
    commit: str | None = None,
) -> None:
    """Write the report, whole or not at all.

    Args:
        path: where.
        findings: of ``findings.json``.
        figures: PNG files by caption, by the section that they belong to: ``where``, ``what``,
            ``proof``, ``forecast`` or ``method``.
        summary: the printed summary, for the end of the page.
        mostly: of more terms than a few, the words of the few that explain nearly all.
        commit: of dashred's own checkout; None names none.
    """
    title = findings["input"]["config"].get("system", {}).get("title", "The system")

    def of(part: str) -> str:
        return drawn(figures.get(part, {}))

    parts = [
        f"<h1>{escape(title)}: the simulation against the recording</h1>",
        '<p class="about">Found by dashred from sensors alone.</p>',
        _verdict(findings, mostly),
        sections.where_it_acts(findings, of(WHERE)),
        sections.the_law(findings, of(WHAT)),
        sections.proof(findings, of(PROOF)),
        sections.forecast(findings, of(FORECAST)),
        sections.unexplained(findings),
        sections.cannot_know(findings),
        how_it_was_done(findings, of(METHOD)),
        provenance(findings, commit),
        f"<details><summary>The printed summary</summary><pre>{escape(summary)}</pre></details>",
    ]
    body = "\n".join(part for part in parts if part)
    write_text_atomic(
        path,
        '<!doctype html>\n<html lang="en">\n<head>\n<meta charset="utf-8">\n'
        '<meta name="viewport" content="width=device-width, initial-scale=1">\n'
        f"<title>{escape(title)}: dashred</title>\n<style>{SCREEN}{PAPER}</style>\n</head>\n"
        f"<body>\n{body}\n</body>\n</html>\n",
    )


def _verdict(findings: Mapping[str, Any], mostly: Sequence[str]) -> str:
    if findings["verdict"] is None:
        return ""
    told = VERDICTS.get(findings["verdict"], "see findings.json")
    said = [] if findings["verdict"] == "outside-library" else causes(findings)
    lines = [f"Verdict: {findings['verdict']}: {told}.", *said, *law(findings)]
    first = paragraphs([headline(findings, mostly)], "headline")
    return f'<div class="verdict">{first}\n{paragraphs(lines)}</div>'
