"""Convert the results of a segment search to laws and states by sample."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import torch
from torch import Tensor

from dashred.inference.fit.law import FittedParameter, Law
from dashred.inference.fit.noise_model import NoiseModel
from dashred.inference.segments.findings.coefficient_covariance import coefficient_covariance
from dashred.inference.segments.findings.error_faults import error_faults
from dashred.inference.segments.segments import Array, Segments
from dashred.inference.segments.selection.search import SegmentSearch
from dashred.inference.segments.selection.set_selection import SegmentLaw


def segment_noise(search: SegmentSearch, noise: NoiseModel) -> NoiseModel:
    """Return the noise that the residuals of the best law indicate.

    Args:
        search: the laws.
        noise: gives the readings that are available; of all episodes, one after the other.
    """
    std = torch.from_numpy(search.problem.noise_std * np.sqrt(search.level))
    return replace(noise, std=std.repeat(len(noise.std) // len(std)))


def law_from_segments(search: SegmentSearch, found: SegmentLaw) -> Law:
    """Return one set of candidates as a law.

    The start is the first node of each episode. The residuals are those within the segments.

    Args:
        search: gives the problem and the noise.
        found: the set.
    """
    problem, nodes, members = search.problem, found.fit.point.nodes, found.members
    segments, (candidates, xi) = problem.segments, search.terms(found)
    readings = problem.read(search.states(found), found.fit.point, members)
    residuals = readings - segments.readings
    covariance, normal = coefficient_covariance(search, found)
    count = len(members)
    misfit = float(np.nansum(np.square(residuals / problem.noise_stds)))
    return Law(
        candidates=candidates,
        coefficients=torch.from_numpy(xi),
        covariance=torch.from_numpy(covariance[:count, :count]),
        start=torch.from_numpy(nodes[segments.begins]),
        score=found.score,
        chi2=misfit / segments.seen / search.level,
        residuals=_by_sample(segments, residuals),
        faults=error_faults(search, found, normal),
        parameters=_fitted_parameters(search, found, covariance.diagonal()[count:]),
    )


def _fitted_parameters(
    search: SegmentSearch, found: SegmentLaw, variance: Array
) -> tuple[FittedParameter, ...]:
    """Return the uncertain parameters of a law with their posterior variances, ``(parameter,)``."""
    known, changes = search.problem.parameters.candidates, found.fit.point.parameters.tolist()
    stds = np.sqrt(np.maximum(variance, 0)).tolist()
    return tuple(map(FittedParameter, known, changes, stds))


def states_by_sample(search: SegmentSearch, found: SegmentLaw) -> list[Tensor]:
    """Return the states of one law at every sample of each episode, ``(time, field)``.

    They follow the law within the segments, and jump by the model error between them.
    """
    segments, states = search.problem.segments, search.states(found)
    return [
        torch.from_numpy(segments.join(states, episode)) for episode in range(len(segments.begins))
    ]


def _by_sample(segments: Segments, values: Array) -> Tensor:
    """Return values by sample, ``(time, episode·sensor)``, NaN after an episode's end."""
    episodes = [segments.join(values, e) for e in range(len(segments.begins))]
    longest = max(map(len, episodes))
    padded = [np.pad(v, ((0, longest - len(v)), (0, 0)), constant_values=np.nan) for v in episodes]
    return torch.from_numpy(np.concatenate(padded, axis=1))
