"""Write `report.html`, a self-contained page without external references."""

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

from dashred.core.files.atomic import write_text_atomic
from dashred.core.formatting import PLUS_MINUS, number
from dashred.core.templates import render
from dashred.core.units import NO_UNITS, TIME, with_unit
from dashred.reporting.figures.figure_names import OF_EQUATIONS
from dashred.reporting.page import sections
from dashred.reporting.page.equations import equations
from dashred.reporting.page.method import method_rows, provenance_rows
from dashred.reporting.page.views import read_figures
from dashred.reporting.text import verdict
from dashred.reporting.text.consequences import consequences
from dashred.reporting.text.fitted_parameters import fitted_parameter_lines
from dashred.reporting.text.headline import headline
from dashred.reporting.text.improvement import (
    UNTESTED,
    assimilation_gains,
    error_before,
    forecast_limits,
    improvements,
)
from dashred.reporting.text.laws import law, other_laws
from dashred.reporting.text.regions import location
from dashred.reporting.text.sources import source
from dashred.reporting.text.support import contradictions, is_confirmed

TEMPLATE = "reporting/page/templates/report.html.j2"
NOTEBOOK_TEMPLATE = "reporting/page/templates/notebook.html.j2"


def write_html(
    path: Path,
    findings: Mapping[str, Any],
    figures: Mapping[str, Mapping[str, Path]],
    summary: str,
    main_effects: Sequence[str] = (),
    commit: str | None = None,
) -> None:
    """Write the report, completely or not at all; the other arguments are those of :func:`page`."""
    write_text_atomic(path, page(findings, figures, summary, main_effects, commit))


def page(
    findings: Mapping[str, Any],
    figures: Mapping[str, Mapping[str, Path]],
    summary: str,
    main_effects: Sequence[str] = (),
    commit: str | None = None,
) -> str:
    """Return the report as HTML.

    Args:
        findings: the content of ``findings.json``.
        figures: PNG files by caption, by section: ``where``, ``what``, ``proof``, ``forecast`` or
            ``method``.
        summary: the printed summary, for the end of the page.
        main_effects: descriptions of the few terms that explain nearly everything, if the law has
            more terms.
        commit: git commit of dashred, or None.
    """
    fit, units, terms = findings["fit"], findings.get("units", NO_UNITS), findings["terms"] or []
    system = findings["input"]["config"].get("system", {})
    splits = findings["input"]["splits"]
    return render(
        TEMPLATE,
        **_head(findings, main_effects),
        fitted_parameters=fitted_parameter_lines(findings),
        untested=findings["verdict"] in UNTESTED,
        location=location(findings["where"], units) if terms else [],
        consequences=consequences(findings),
        terms=sections.terms_table(findings),
        probabilities=sections.cause_probabilities(findings),
        other_laws=other_laws(findings),
        alternatives=sections.alternatives_table(findings["alternatives"] or []),
        errors=sections.errors_table(fit),
        improvements=[*improvements(findings), *assimilation_gains(findings)],
        forecast_errors=_forecast_errors(findings),
        forecast_limits=forecast_limits(findings),
        inputs=system.get("inputs"),
        unexplained=sections.unexplained(findings),
        limits=verdict.limits(findings),
        splits=splits,
        until=with_unit(number(splits["time_end"]), units.get(TIME)) if splits else "",
        method=method_rows(findings),
        provenance=provenance_rows(findings, commit),
        figures={place: read_figures(figures.get(place, {})) for place in OF_EQUATIONS},
        summary=summary,
    )


def _forecast_errors(findings: Mapping[str, Any]) -> list[str]:
    """Return the errors in the held-out time with the correction and without it; or nothing."""
    errors = findings["fit"]["heldout_time"] or {}
    known = [errors.get("corrected"), error_before(findings, "heldout_time")]
    return [] if None in known else [f"{error:.3g}" for error in known]


def notebook_html(findings: Mapping[str, Any], main_effects: Sequence[str] = ()) -> str:
    """Return the head of the report with the corrected equations, for a notebook cell."""
    return render(NOTEBOOK_TEMPLATE, **_head(findings, main_effects))


def _head(findings: Mapping[str, Any], main_effects: Sequence[str]) -> dict[str, Any]:
    """Return the variables of the head of the page."""
    return {
        "title": findings["input"]["config"].get("system", {}).get("title", "The system"),
        "headline": headline(findings, main_effects) if findings["verdict"] else "",
        "verdict": findings["verdict"],
        "plus_minus": PLUS_MINUS,
        "is_confirmed": is_confirmed(findings),
        "statements": _statements(findings),
        "equations": equations(findings),
    }


def _statements(findings: Mapping[str, Any]) -> list[str]:
    """Return the meaning of the verdict and the law, one sentence each."""
    kind = findings["verdict"]
    if kind is None:
        return []
    causes = [] if kind == "outside-library" else verdict.causes(findings)
    return [
        f"Verdict: {kind}: {verdict.meaning(findings)}.",
        *contradictions(findings),
        *causes,
        *source(findings),
        *law(findings),
    ]
