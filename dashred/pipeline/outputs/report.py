"""Write the report of an analysis: the figures and the HTML page."""

from __future__ import annotations

from pathlib import Path

from dashred.core.findings.schema import Findings
from dashred.core.progress import stage
from dashred.pipeline.analysis import Analysis
from dashred.pipeline.outputs.figures import figures_of
from dashred.pipeline.problem import Problem
from dashred.pipeline.run.provenance import git_commit
from dashred.reporting.figures.figure_names import (
    OF_EQUATIONS,
    PROOF,
    SENSORS_CAPTION,
    Captions,
    sensor_figure_of_episode,
)
from dashred.reporting.figures.gallery import Gallery
from dashred.reporting.page import html
from dashred.reporting.text.laws import main_terms
from dashred.reporting.text.summary import summary
from dashred.reporting.wording.findings_text import describe


def report(
    problem: Problem,
    analysis: Analysis,
    findings: Findings,
    output: Path,
    seconds: dict[str, float],
) -> list[Path]:
    """Write the figures and the page to ``output`` and return the paths of the figures."""
    gallery = Gallery(output)
    with stage("draw figures", seconds) as show:
        left_out = gallery.draw(
            figures_of(problem, analysis, findings), problem.deadline("draw figures")
        )
        if left_out:
            show(1.0, f"no time for {', '.join(left_out)}")
        figures = gallery.captioned(_captions(problem))
        text, effects = summary(findings, None, {}), main_effects(problem, findings)
        html.write_html(output / "report.html", findings, figures, text, effects, git_commit())
    return gallery.drawn


def report_unresolved(findings: Findings, output: Path) -> list[Path]:
    """Write the page for a simulator that is not resolved; there are no figures."""
    text = summary(findings, None, {})
    html.write_html(output / "report.html", findings, {}, text, commit=git_commit())
    return []


def main_effects(problem: Problem, findings: Findings) -> list[str]:
    """Return the effects of the few main terms of a law with many terms."""
    few = main_terms(findings)
    terms = few["terms"] if few else []
    if any(term["equation"] is None for term in terms):
        return []
    return [describe(term, problem.system).effect for term in terms]


def _captions(problem: Problem) -> Captions:
    """Return the captions of the figures, including the sensor figures of all fitted episodes."""
    others = {
        f"{SENSORS_CAPTION} in episode {episode.name}": sensor_figure_of_episode(number)
        for number, episode in enumerate(problem.others, start=2)
    }
    return OF_EQUATIONS | {PROOF: OF_EQUATIONS[PROOF] | others}
