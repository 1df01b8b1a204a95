"""Draw what the analysis itself may show: no truth is in reach here."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from dashred.core.findings.law_schema import Where
from dashred.core.findings.schema import Findings
from dashred.core.progress import stage
from dashred.core.units import label_with_unit, time_label
from dashred.inference.latent_sindy.sparse_regression import SparseFit
from dashred.inference.results.location import law_tendency
from dashred.physics.system import Term
from dashred.pipeline.analysis import Analysis
from dashred.pipeline.assimilation import Assimilated
from dashred.pipeline.outputs.sensor_figures import (
    draw_forecast,
    draw_traces,
    draw_verification,
    draw_whole_episode,
)
from dashred.pipeline.problem import Problem
from dashred.pipeline.run.provenance import git_commit
from dashred.reporting.figures.figure_names import (
    OF_EQUATIONS,
    PROOF,
    SENSORS,
    WHOLE,
    Captions,
    sensors_of_episode,
)
from dashred.reporting.figures.gallery import Gallery
from dashred.reporting.figures.save import (
    LatentPath,
    LawMap,
    accuracy_against_sparsity,
    coefficients_against_epoch,
    epochs_and_values,
    evidence_figure,
    forcing_figure,
    learning_curves,
    snapshot_panels,
    space_time_panels,
    where_figure,
)
from dashred.reporting.page import html
from dashred.reporting.text.summary import summary
from dashred.reporting.text.verdict import main_terms
from dashred.reporting.wording.findings_text import describe

PANELS = ("simulation", "dashred", "corrected")
TITLES = {"alg1": "Algorithm 1", "alg2": "Algorithm 2"}


def report(
    problem: Problem,
    analysis: Analysis,
    findings: Findings,
    output: Path,
    seconds: dict[str, float],
) -> list[Path]:
    """Save every figure of the analysis in ``output``, and the page; returns the figures."""
    gallery = Gallery(output)
    with stage("draw figures", seconds):
        for number, (episode, mine) in enumerate(analysis.episodes(problem), start=1):
            draw_traces(episode, mine, gallery, sensors_of_episode(number))
        for whole, free in zip(problem.whole, analysis.free.whole, strict=True):
            draw_whole_episode(whole, free, gallery, WHOLE)
        _coefficients(problem, analysis.found, gallery)
        _sparsity(analysis, gallery)
        _curves(analysis, gallery)
        draw_verification(problem, analysis, findings, gallery)
        if findings["where"] is not None:
            draw_forecast(problem, analysis, gallery)
            found, terms = analysis.discovered, findings["terms"] or []
            path = [(len(best.candidates), best.score) for best in found.path]
            gallery.save(evidence_figure(path, terms, found.on_path), "evidence.png")
            _where(problem, analysis, findings["where"], gallery)
        if problem.system.axes:
            _fields(problem, analysis, gallery)
        figures = gallery.captioned(_captions(problem))
        text, mostly = summary(findings, None, {}), _mostly(problem, findings)
        html.write_html(output / "report.html", findings, figures, text, mostly, git_commit())
    return gallery.drawn


def report_unresolved(findings: Findings, output: Path) -> list[Path]:
    """Write the page of a simulator that is too coarse to learn from: there is nothing to draw."""
    text = summary(findings, None, {})
    html.write_html(output / "report.html", findings, {}, text, commit=git_commit())
    return []


def _captions(problem: Problem) -> Captions:
    """Return the captions of the figures, those of every fitted episode's sensors among them."""
    others = {
        f"{SENSORS} in episode {episode.name}": sensors_of_episode(number)
        for number, episode in enumerate(problem.others, start=2)
    }
    return OF_EQUATIONS | {PROOF: OF_EQUATIONS[PROOF] | others}


def _mostly(problem: Problem, findings: Findings) -> list[str]:
    """Return the effects of the few terms that explain nearly all of what many do."""
    few = main_terms(findings)
    terms = few["terms"] if few else []
    if any(term["equation"] is None for term in terms):
        return []
    return [describe(term, problem.system).effect for term in terms]


def _where(problem: Problem, analysis: Analysis, where: Where, gallery: Gallery) -> None:
    system, fit = problem.system, problem.split.fit
    count, law_map = len(fit.times), None
    if len(system.axes) == 1:
        [axis] = system.axes
        states = analysis.free.states["corrected"][:count]
        tendency = law_tendency(system, analysis.discovered.best, states, problem.times[:count])
        law_map = LawMap(
            axis.name,
            system.grid.own_coordinates[axis.name].numpy(),
            problem.times[:count].numpy(),
            system.grid.own(tendency.square().sum(dim=1).sqrt()).numpy(),
            {sensor.name: sensor.position[0] for sensor in fit.sensors},
        )
        if where["forcing"] is not None:
            places = list(law_map.sensors.values())
            label, clock = (
                label_with_unit(axis.name, system.units.get(axis.name)),
                time_label(system.units),
            )
            figure = forcing_figure(where["forcing"], label, axis.length, places, clock)
            gallery.save(figure, "forcing.png")
    gallery.save(where_figure(where, law_map, system.units), "where.png")


def _coefficients(problem: Problem, found: Assimilated, gallery: Gallery) -> None:
    panels = {
        title: varying(problem.library, np.array(found.coefficients[name]))
        for name, title in TITLES.items()
    }
    figure = coefficients_against_epoch(
        np.array(found.epochs), panels, "What latent SINDy proposes, by epoch of assimilation"
    )
    gallery.save(figure, "coefficients.png")


def varying(library: list[Term], history: np.ndarray) -> dict[str, np.ndarray]:
    """Return the coefficients by epoch, ``(epoch,)`` by term, that are not always zero."""
    return {
        f"{term.equation}: {term}": history[:, j]
        for j, term in enumerate(library)
        if history.size and np.any(history[:, j] != 0)
    }


def _sparsity(analysis: Analysis, gallery: Gallery) -> None:
    latent = {TITLES[name]: _path(fit) for name, fit in analysis.found.proposals.items()}
    discovered = analysis.discovered
    law = [(len(best.candidates), best.rmse, best.score) for best in discovered.path]
    figure = accuracy_against_sparsity(latent, law, discovered.on_path)
    gallery.save(figure, "sparsity.png")


def _path(fit: SparseFit) -> LatentPath:
    sizes, errors = zip(*fit.path, strict=True)
    kept = int(np.count_nonzero(fit.coefficients))
    return LatentPath(np.array(sizes), np.array(errors), fit.blocks, kept)


def _curves(analysis: Analysis, gallery: Gallery) -> None:
    named = {
        "SHRED, unseen simulations": analysis.learned.curves["rmse/field_members"],
        "DA-SHRED, fitted": analysis.found.curves["rmse/sensors_fit"],
        "DA-SHRED, validation": analysis.found.curves["rmse/sensors_validate"],
        "corrected SHRED": analysis.relearned.curves["rmse/field_members"],
    }
    curves = {name: epochs_and_values(points) for name, points in named.items()}
    gallery.save(learning_curves(curves, "RMSE / standard deviation"), "learning.png")


def _fields(problem: Problem, analysis: Analysis, gallery: Gallery) -> None:
    system, split = problem.system, problem.split
    count = len(split.fit.times)
    times, coordinates = problem.times[:count].numpy(), system.grid.own_coordinates
    fields = {
        field: {
            name: system.grid.own(states[:, i]).numpy()
            for name, states in analysis.estimates(count).items()
            if name in PANELS
        }
        for i, field in enumerate(system.fields)
    }
    places = {
        field: [s.position for s in split.fit.sensors if s.reads == field]
        for field in system.fields
    }
    if len(system.axes) == 1:
        [axis] = system.axes
        figure = space_time_panels(
            times,
            label_with_unit(axis.name, system.units.get(axis.name)),
            coordinates[axis.name].numpy(),
            fields,
            {field: [x for (x,) in positions] for field, positions in places.items()},
            meanings={
                field: label_with_unit(meaning, system.units.get(field))
                for field, meaning in system.config.fields.items()
            },
            clock=time_label(system.units),
        )
        gallery.save(figure, "space_time.png")
    else:
        along = {name: x.numpy() for name, x in coordinates.items()}
        gallery.save(snapshot_panels(times, along, fields, places, system.units), "snapshots.png")
