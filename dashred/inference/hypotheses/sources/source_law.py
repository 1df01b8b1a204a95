"""A fitted source as a law and as it is reported."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import replace

import torch
from torch import Tensor

from dashred.inference.fit.fitted_law import build_law
from dashred.inference.fit.least_squares import LeastSquaresProblem
from dashred.inference.fit.levenberg_marquardt import minimise
from dashred.inference.fit.located_source import LocatedSource
from dashred.inference.forward.candidates import Candidate
from dashred.inference.hypotheses.hypothesis_fit import STEPS, TOLERANCE, HypothesisFit
from dashred.inference.hypotheses.result import AMBIGUITY_MARGIN
from dashred.inference.hypotheses.sources.course_period import course_period
from dashred.inference.hypotheses.sources.courses import Free, Onset
from dashred.inference.hypotheses.sources.find_source import FoundSource
from dashred.inference.hypotheses.sources.screening import Source
from dashred.physics.system import System, Term

# Number of times at which the rate of a source is reported.
REPORTED_TIMES = 200
# Relative step of differences.
STEP = 1e-3


def fit_source_law(null: LeastSquaresProblem, found: FoundSource, size: Tensor) -> HypothesisFit:
    """Return the law of a source.

    A term of the library is preferred to a source that is as good.

    Args:
        null: F of the start alone.
        found: the source.
        size: rms of each equation's own tendency, ``(equation,)``.
    """
    system = null.forward_model.simulator.system
    terms = found.fit.source.course.terms(found.fit.source.amplitudes)
    candidates = _candidates(system, found.fit.source, [text for text, _ in terms], size)
    problem = null.with_candidates(candidates)
    coefficients = torch.tensor([value for _, value in terms], dtype=torch.float64)
    begin = torch.cat([found.fit.phi, coefficients])
    fitted = minimise(problem, begin, STEPS, TOLERANCE)
    law = build_law(problem, fitted, fitted.cost + found.penalty + AMBIGUITY_MARGIN)
    law = replace(law, source=locate_source(null, found))
    return HypothesisFit(law, problem, fitted.phi)


def _candidates(
    system: System, source: Source, courses: Sequence[str], size: Tensor
) -> list[Candidate]:
    """Return a candidate for every term of the course."""
    equation, bump = system.fields[source.equation], source.bump.text(system)
    texts = [bump if course == "1" else f"{bump}*{course}" for course in courses]
    key, std = f"library.{equation}", source.amplitude_std(system, size)
    found = []
    for text in texts:
        expression = system.parse(text, key, equation=equation)
        term = Term(equation, system.ready(expression, equation, key))
        found.append(Candidate(text, equation, (term,), std, is_extended=True))
    return found


def locate_source(null: LeastSquaresProblem, found: FoundSource) -> LocatedSource:
    """Return a source as it is reported.

    Its standard deviations are multiplied by the square root of χ²/n if the source does not explain
    the whole misfit.
    """
    model, fit = null.forward_model, found.fit
    system, source, times = model.simulator.system, fit.source, model.times
    scale = math.sqrt(max(1.0, fit.chi2 / null.noise.count))
    stds = (fit.covariance.diagonal().clamp(min=0).sqrt() * scale).tolist()
    count, axes = len(source.amplitudes), len(system.axes)
    course_std = stds[count + axes + 1] if source.course.unknowns else None
    begin = source.course.begin if isinstance(source.course, Onset) else None
    clock = torch.linspace(float(times.min()), float(times.max()), REPORTED_TIMES).double()
    rates = _rates(system, source, clock)
    period = _period(source, course_std)
    slopes = _strength_slopes(system, source, clock)
    variance = float(slopes @ fit.covariance[: len(slopes), : len(slopes)] @ slopes)
    return LocatedSource(
        equation=system.fields[source.equation],
        axes=tuple(axis.name for axis in system.axes),
        place=source.bump.centre,
        place_std=tuple(stds[count : count + axes]),
        region=tuple(source.bump.region(axis, i) for i, axis in enumerate(system.axes)),
        period=period and period[0],
        period_std=period and period[1],
        begin=begin,
        begin_std=course_std if begin is not None else None,
        strength=float(rates.mean()),
        strength_std=scale * math.sqrt(max(variance, 0.0)),
        share=found.share,
        times=tuple(clock.tolist()),
        rates=tuple(rates.tolist()),
    )


def _period(source: Source, course_std: float | None) -> tuple[float, float] | None:
    """Return the period of a source and its standard deviation; None if it is not periodic."""
    course = source.course
    if course.period is not None and course_std is not None:
        return course.period, course_std * course.period**2 / (2 * math.pi)
    if not isinstance(course, Free):
        return None
    # At the knots, because values between them are not independent.
    return course_period(course.knots.numpy(), (course.modes @ source.amplitudes).numpy())


def _rates(system: System, source: Source, times: Tensor) -> Tensor:
    """Return the integral of a source over the domain, ``(time,)``."""
    course = source.course.functions(times) @ source.amplitudes
    return source.bump.integral(system) * course


def _strength_slopes(system: System, source: Source, times: Tensor) -> Tensor:
    """Return the derivatives of the strength by the amplitudes, the place and ln of the width."""
    strength = _rates(system, source, times).mean()
    functions = source.course.functions(times).mean(dim=0) * source.bump.integral(system)
    axes = len(system.axes)
    by_shape = []
    for index in range(axes + 1):
        move = [0.0] * (axes + 1)
        move[index] = STEP * (source.bump.width if index < axes else 1.0)
        moved = replace(source, bump=source.bump.moved(move))
        by_shape.append((_rates(system, moved, times).mean() - strength) / move[index])
    return torch.cat([functions, torch.stack(by_shape)])
