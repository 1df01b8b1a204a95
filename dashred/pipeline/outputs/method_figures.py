"""Draw how the analysis went: what latent SINDy proposed, how sparse it is, how learning went."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import numpy as np
from matplotlib.figure import Figure

from dashred.inference.latent_sindy.sparse_regression import SparseFit
from dashred.physics.system import Term
from dashred.pipeline.analysis import Analysis
from dashred.pipeline.assimilation import AssimilationResult
from dashred.pipeline.problem import Problem
from dashred.reporting.figures.save import (
    LatentPath,
    accuracy_against_sparsity,
    coefficients_against_epoch,
    epochs_and_values,
    learning_curves,
)

TITLES = {"alg1": "Algorithm 1", "alg2": "Algorithm 2"}


def draw_coefficients(problem: Problem, found: AssimilationResult) -> Figure:
    """Draw the coefficients of latent SINDy by epoch."""
    panels = {
        title: varying(problem.library, np.array(found.coefficients[name]))
        for name, title in TITLES.items()
    }
    title = "What latent SINDy proposes, by epoch of assimilation"
    return coefficients_against_epoch(np.array(found.epochs), panels, title)


def varying(library: list[Term], history: np.ndarray) -> dict[str, np.ndarray]:
    """Return the coefficients by epoch, ``(epoch,)`` by term, that are not always zero."""
    return {
        f"{term.equation}: {term}": history[:, j]
        for j, term in enumerate(library)
        if history.size and np.any(history[:, j] != 0)
    }


def draw_sparsity(analysis: Analysis) -> Figure:
    """Draw the accuracy of latent SINDy and of the law against the number of terms."""
    latent = {TITLES[name]: _path(fit) for name, fit in analysis.assimilated.proposals.items()}
    discovered = analysis.discovery
    law = [(len(best.candidates), best.rmse, best.score) for best in discovered.path]
    return accuracy_against_sparsity(latent, law, discovered.on_path)


def draw_learning(named: Mapping[str, Sequence[tuple[int, float]]]) -> Figure:
    """Draw learning curves, (epoch, RMSE) by name."""
    curves = {name: epochs_and_values(points) for name, points in named.items()}
    return learning_curves(curves, "RMSE / standard deviation")


def _path(fit: SparseFit) -> LatentPath:
    sizes, errors = zip(*fit.path, strict=True)
    kept = int(np.count_nonzero(fit.coefficients))
    return LatentPath(np.array(sizes), np.array(errors), fit.blocks, kept)
