"""Figures of the methods: latent SINDy, sparsity and learning curves."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import numpy as np
from matplotlib.figure import Figure

from dashred.inference.latent_sindy.sparse_regression import SparseFit
from dashred.physics.system import Term
from dashred.pipeline.analysis import Analysis
from dashred.pipeline.networks.assimilation import AssimilationResult
from dashred.pipeline.problem import Problem
from dashred.reporting.figures.save import (
    LatentPath,
    accuracy_against_sparsity,
    coefficients_against_epoch,
    epochs_and_values,
    learning_curves,
)

DYNAMICS = "With dynamics"
TITLES = {"alg1": "Algorithm 1", "alg2": "Algorithm 2", "dynamics": DYNAMICS}


def draw_coefficients(problem: Problem, assimilated: AssimilationResult) -> Figure:
    """Draw the coefficients of latent SINDy by epoch."""
    panels = {
        title: nonzero_coefficients(problem.library, np.array(assimilated.coefficients[name]))
        for name, title in TITLES.items()
        if name in assimilated.coefficients
    }
    if DYNAMICS in panels:
        panels[DYNAMICS] |= {
            f"parameter {name}": np.array(curve)
            for name, curve in assimilated.tangents.items()
            if any(curve)
        }
    title = "Coefficients that latent SINDy proposes, by epoch of assimilation"
    return coefficients_against_epoch(np.array(assimilated.epochs), panels, title)


def nonzero_coefficients(library: list[Term], history: np.ndarray) -> dict[str, np.ndarray]:
    """Return the coefficients by epoch, ``(epoch,)``, of the terms that are not always zero."""
    return {
        f"{term.equation}: {term}": history[:, j]
        for j, term in enumerate(library)
        if history.size and np.any(history[:, j] != 0)
    }


def draw_sparsity(analysis: Analysis) -> Figure:
    """Draw the accuracy of latent SINDy and of the law against the number of terms."""
    latent = {TITLES[name]: _path(fit) for name, fit in analysis.assimilated.proposals.items()}
    discovery = analysis.discovery
    law = [(len(best.candidates), best.rmse, best.score) for best in discovery.path]
    return accuracy_against_sparsity(latent, law, discovery.path_index)


def draw_learning(named: Mapping[str, Sequence[tuple[int, float]]]) -> Figure:
    """Draw learning curves by name, each as pairs (epoch, RMSE)."""
    curves = {name: epochs_and_values(points) for name, points in named.items()}
    return learning_curves(curves, "RMSE / standard deviation")


def _path(fit: SparseFit) -> LatentPath:
    sizes, errors = zip(*fit.path, strict=True)
    selected = int(np.count_nonzero(fit.coefficients))
    return LatentPath(np.array(sizes), np.array(errors), fit.blocks, selected)
