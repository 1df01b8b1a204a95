"""`report.html`: one page that holds all a reader needs, and refers to nothing outside it."""

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

from dashred.core.files.atomic import write_text_atomic
from dashred.core.formatting import number
from dashred.core.templates import render
from dashred.core.units import NO_UNITS, TIME, with_unit
from dashred.reporting.figures.figure_names import OF_EQUATIONS
from dashred.reporting.page import sections
from dashred.reporting.page.equations import equations
from dashred.reporting.page.method import provenance, set_up
from dashred.reporting.page.views import figures as drawn
from dashred.reporting.text import verdict
from dashred.reporting.text.headline import headline
from dashred.reporting.text.improvement import UNTESTED, assimilation_gains, improvements

TEMPLATE = "reporting/page/templates/report.html.j2"
IN_NOTEBOOKS = "reporting/page/templates/notebook.html.j2"


def write_html(
    path: Path,
    findings: Mapping[str, Any],
    figures: Mapping[str, Mapping[str, Path]],
    summary: str,
    mostly: Sequence[str] = (),
    commit: str | None = None,
) -> None:
    """Write the report, whole or not at all; the arguments after ``path`` are those of `page`."""
    write_text_atomic(path, page(findings, figures, summary, mostly, commit))


def page(
    findings: Mapping[str, Any],
    figures: Mapping[str, Mapping[str, Path]],
    summary: str,
    mostly: Sequence[str] = (),
    commit: str | None = None,
) -> str:
    """Return the report.

    Args:
        findings: of ``findings.json``.
        figures: PNG files by caption, by the section that they belong to: ``where``, ``what``,
            ``proof``, ``forecast`` or ``method``.
        summary: the printed summary, for the end of the page.
        mostly: of more terms than a few, the words of the few that explain nearly all.
        commit: of dashred's own checkout; None names none.
    """
    fit, units, found = findings["fit"], findings.get("units", NO_UNITS), findings["terms"] or []
    system = findings["input"]["config"].get("system", {})
    splits = findings["input"]["splits"]
    return render(
        TEMPLATE,
        **_head(findings, mostly),
        untested=findings["verdict"] in UNTESTED,
        location=verdict.location(findings["where"], units) if found else [],
        consequences=verdict.consequences(findings),
        terms=sections.terms(found),
        weighed=sections.weighed(findings["causes"] or []),
        certainty=verdict.certainty(findings),
        alternatives=sections.alternatives(findings["alternatives"] or []),
        errors=sections.proof(fit),
        improvements=[*improvements(fit), *assimilation_gains(findings)],
        heldout=fit["heldout_time"] or {},
        inputs=system.get("inputs"),
        unexplained=sections.unexplained(findings),
        limits=verdict.limits(findings),
        splits=splits,
        until=with_unit(number(splits["time_end"]), units.get(TIME)) if splits else "",
        set_up=set_up(findings),
        provenance=provenance(findings, commit),
        figures={place: drawn(figures.get(place, {})) for place in OF_EQUATIONS},
        summary=summary,
    )


def in_notebook(findings: Mapping[str, Any], mostly: Sequence[str] = ()) -> str:
    """Return the report's head with the corrected equations, as a part of another page."""
    return render(IN_NOTEBOOKS, **_head(findings, mostly))


def _head(findings: Mapping[str, Any], mostly: Sequence[str]) -> dict[str, Any]:
    """What the head of the page names, and the corrected equations."""
    return {
        "title": findings["input"]["config"].get("system", {}).get("title", "The system"),
        "headline": headline(findings, mostly) if findings["verdict"] else "",
        "verdict": findings["verdict"],
        "said": _said(findings),
        "equations": equations(findings),
    }


def _said(findings: Mapping[str, Any]) -> list[str]:
    """What the verdict means, and the law: a sentence each."""
    kind = findings["verdict"]
    if kind is None:
        return []
    causes = [] if kind == "outside-library" else verdict.causes(findings)
    told = verdict.VERDICTS.get(kind, "see findings.json")
    return [f"Verdict: {kind}: {told}.", *causes, *verdict.law(findings)]
