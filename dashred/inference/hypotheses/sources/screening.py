"""Screening of localised sources on the linearised problem of a fine free forcing.

A bump is a weighted sum of cells, and a course is a weighted sum of knots. The columns of every
source are therefore combinations of the columns of the fine forcing.
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from dataclasses import dataclass

import torch
from torch import Tensor

from dashred.inference.fit.selection.subset_search import ProfiledProblem
from dashred.inference.hypotheses.sources.bump import Bump
from dashred.inference.hypotheses.sources.courses import Constant, Course, Free, Onset, Periodic
from dashred.inference.hypotheses.sources.smooth_forcing import LinearisedForcing, modes_in_time
from dashred.physics.forcing_basis import cell_centres
from dashred.physics.system import System

# Widths of the bumps, in cells, and the largest as a share of the mean length of the axes.
WIDTHS, WIDEST = (0.5, 0.8, 1.3, 2.0, 3.2), 0.2
# Step between frequencies, in periods over the record, and the fewest knots in a period.
FREQUENCY_STEP, KNOTS_PER_PERIOD = 0.1, 2.5
HARMONICS = (1, 2)
# Correlation length of a free course, in knots.
FREE_LENGTH = 1.4
# Prior std of the rms of a source, in units of the tendency of its equation.
LEVEL = 3.0


@dataclass(frozen=True)
class Source:
    """A source ``b(x) Σ_j a_j h_j(t)`` in one equation.

    Attributes:
        equation: index of the equation.
        bump: b.
        course: the functions h.
        amplitudes: a, ``(function,)``.
    """

    equation: int
    bump: Bump
    course: Course
    amplitudes: Tensor

    @property
    def shape_unknowns(self) -> int:
        """Number of the unknowns of its bump and its course, without the amplitudes."""
        return len(self.bump.centre) + 1 + len(self.course.unknowns)

    def amplitude_std(self, system: System, size: Tensor) -> float:
        """Return the prior std of its amplitudes; a narrow bump may be high.

        Args:
            system: the simulator.
            size: rms of each equation's own tendency, ``(equation,)``.
        """
        rms = float(self.bump.on_grid(system).square().mean().sqrt())
        return LEVEL * float(size[self.equation]) / max(rms, 1e-12)


@dataclass(frozen=True)
class ScreenedSource:
    """A source with its fit on the linearised problem.

    Attributes:
        source: the source.
        penalty: penalty for its unknowns and for the search.
        score: the minimum of F, plus the penalty.
    """

    source: Source
    penalty: float
    score: float


def screen_sources(
    fine: LinearisedForcing, equations: Sequence[int], candidate_count: int
) -> tuple[list[ScreenedSource], float]:
    """Return the best source of every kind of course, and the minimum of F without a source.

    Args:
        fine: the linearised problem.
        equations: indices of the equations that may have a source.
        candidate_count: number of terms tried before, for the penalty of the search.
    """
    problem = ProfiledProblem.from_normal_equations(fine.normal, fine.own)
    system = fine.objective.forward_model.simulator.system
    bumps = list(_bumps(system, fine.block.basis.mesh))
    best: dict[object, ScreenedSource] = {}
    for equation in equations:
        for kind, found in _screen_equation(fine, problem, bumps, equation, candidate_count):
            if kind not in best or found.score < best[kind].score:
                best[kind] = found
    return sorted(best.values(), key=lambda found: found.score), problem.constant


def _screen_equation(
    fine: LinearisedForcing,
    problem: ProfiledProblem,
    bumps: Sequence[Bump],
    equation: int,
    candidate_count: int,
) -> Iterator[tuple[object, ScreenedSource]]:
    """Yield the best source of every kind in one equation."""
    basis, system = fine.block.basis, fine.objective.forward_model.simulator.system
    fields, cells, knots = basis.shape
    gram = problem.gram.reshape(fields, cells, knots, fields, cells, knots)[
        equation, :, :, equation
    ]
    target = problem.target.reshape(fields, cells, knots)[equation]
    centres = cell_centres(system, basis.mesh)
    weights = torch.stack([bump.at(centres, system) for bump in bumps])
    half = torch.tensordot(weights, gram, dims=1)
    by_bump = torch.einsum("vkdl,vd->vkl", half, weights)
    right = weights @ target
    samples = fine.objective.noise.effective_count
    for kind, courses in _courses(basis.knots).items():
        functions = torch.stack([course.functions(basis.knots) for course in courses])
        matrix = torch.einsum("wki,vkl,wlj->vwij", functions, by_bump, functions)
        vector = torch.einsum("wki,vk->vwi", functions, right)
        first = [Source(equation, bump, courses[0], functions[0, 0]) for bump in bumps]
        stds = torch.tensor([s.amplitude_std(system, fine.block.size) for s in first])
        prior = torch.eye(functions.shape[2], dtype=torch.float64) * stds[:, None, None, None] ** -2
        solved = torch.linalg.solve(matrix + prior, vector[..., None])[..., 0]
        gains = (solved * vector).sum(dim=-1)
        place = int(gains.argmax())
        v, w = divmod(place, len(courses))
        source = Source(equation, bumps[v], courses[w], solved[v, w])
        choices = fields * len(bumps) * max(1.0, len(courses) * _independent(kind))
        penalty = source.shape_unknowns * math.log(samples)
        penalty += 2 * math.log(candidate_count + choices)
        penalty += _amplitude_penalty(source, matrix[v, w], float(stds[v]), samples)
        score = problem.constant - float(gains[v, w]) + penalty
        yield kind, ScreenedSource(source, penalty, score)


def _amplitude_penalty(source: Source, matrix: Tensor, std: float, samples: float) -> float:
    """Return the penalty for the amplitudes: ``ln n`` for each, of a free course the evidence.

    Args:
        source: the source.
        matrix: ``JᵀJ`` of its amplitudes, ``(function, function)``.
        std: prior standard deviation of every amplitude.
        samples: n.
    """
    count = len(source.amplitudes)
    if source.course.has_form:
        return count * math.log(samples)
    return float(torch.logdet(torch.eye(count, dtype=torch.float64) + std**2 * matrix))


def _independent(kind: object) -> float:
    """Return the share of the courses of a kind that differ: near frequencies are alike."""
    return FREQUENCY_STEP if kind in HARMONICS else 1.0


def _bumps(system: System, mesh: Sequence[int]) -> Iterator[Bump]:
    """Yield bumps of several widths about the centre of every cell."""
    spacing = max(axis.length / count for axis, count in zip(system.axes, mesh, strict=True))
    for width in WIDTHS:
        if width == WIDTHS[0] or width * spacing <= widest_bump(system):
            for centre in cell_centres(system, mesh).tolist():
                yield Bump(tuple(centre), width * spacing)


def widest_bump(system: System) -> float:
    """Return the largest width of a localised source."""
    lengths = [axis.length for axis in system.axes]
    return WIDEST * math.prod(lengths) ** (1 / len(lengths))


def _courses(knots: Tensor) -> dict[object, list[Course]]:
    """Return the courses of every kind."""
    spacing, duration = float(knots[1] - knots[0]), float(knots[-1] - knots[0])
    found: dict[object, list[Course]] = {"constant": [Constant()]}
    found["free"] = [Free(knots, modes_in_time(len(knots), FREE_LENGTH))]
    found["onset"] = [Onset(float(begin), spacing / 2) for begin in knots[2:-2]]
    for harmonics in HARMONICS:
        most = len(knots) / KNOTS_PER_PERIOD / harmonics
        turns = torch.arange(1.0, max(most, 1.5), FREQUENCY_STEP, dtype=torch.float64)
        found[harmonics] = [
            Periodic(2 * math.pi * float(turn) / duration, harmonics, duration) for turn in turns
        ]
    return found
