"""A localised source as a hypothesis beside the laws."""

from __future__ import annotations

from dataclasses import dataclass

from torch import Tensor

from dashred.core.progress import Report
from dashred.inference.fit.located_source import LocatedSource
from dashred.inference.hypotheses.comparison.residual_forcing import ResidualForcing
from dashred.inference.hypotheses.forcing_map import ForcingMap
from dashred.inference.hypotheses.hypothesis_fit import (
    REJECTION_MARGIN,
    HypothesisFit,
    by_score,
)
from dashred.inference.hypotheses.result import AMBIGUITY_MARGIN
from dashred.inference.hypotheses.sensors.excluded_sensors import with_all_samples
from dashred.inference.hypotheses.sources.courses import Constant
from dashred.inference.hypotheses.sources.find_source import (
    FoundSource,
    find_source,
    refit_source,
    rival_score,
)
from dashred.inference.hypotheses.sources.smooth_forcing import (
    build_smooth_map,
    fit_smooth_forcing,
    linearise_fine_forcing,
)
from dashred.inference.hypotheses.sources.source_law import fit_source_law, locate_source

# A source that leaves a larger χ²/n does not end the search for a law.
MAX_SOURCE_CHI2 = 1.5


@dataclass(frozen=True)
class SourceHypothesis:
    """The best localised source, if there is one.

    Attributes:
        located: the source as it is reported; None if no source explains most of the misfit.
        fits: its law, if it is not much worse than the best other hypothesis.
        is_clear: whether the source explains the recording and no single term that acts at its
            place comes near. Laws in windows are then not searched.
    """

    located: LocatedSource | None = None
    fits: tuple[HypothesisFit, ...] = ()
    is_clear: bool = False


def fit_local_source(
    residual: ResidualForcing,
    null: HypothesisFit,
    best: HypothesisFit,
    size: Tensor,
    candidate_count: int,
    report: Report,
) -> SourceHypothesis:
    """Search for a localised source that replaces the law.

    Args:
        residual: the free forcings.
        null: the simulator without a law.
        best: the best other hypothesis.
        size: rms of each equation's own tendency, ``(equation,)``.
        candidate_count: number of terms tried before, for the penalty of the search.
        report: progress.
    """
    forcing = residual.forcings[0]
    found = find_source(null.objective, null.phi, forcing, size, candidate_count)
    if found is None:
        return SourceHypothesis()
    objective, faulty = null.objective, residual.faulty
    if faulty:
        # A source that the forcing does not resolve may have looked like a fault.
        everything = with_all_samples(objective)
        whole = refit_source(everything, found, size)
        if whole.fit.chi2 < MAX_SOURCE_CHI2 * everything.noise.count:
            objective, found, faulty = everything, whole, ()
    report(0.35, f"a localised source leaves χ²/n {found.fit.chi2 / objective.noise.count:.2f}")
    located = locate_source(objective, found)
    if found.score > best.law.score + AMBIGUITY_MARGIN:
        return SourceHypothesis(located)
    fits = [fit_source_law(objective, found, size)]
    if faulty:
        fits = residual.add_faults(fits)
    leader = min(fits, key=by_score)
    return SourceHypothesis(located, tuple(fits), _is_clear(residual, found, leader, best))


def _is_clear(
    residual: ResidualForcing, found: FoundSource, fit: HypothesisFit, best: HypothesisFit
) -> bool:
    """Return whether no other hypothesis may explain what the source explains.

    A steady source is always compared with laws in windows, because a term of a field that hardly
    changes is alike.
    """
    score = fit.law.score
    if isinstance(found.fit.source.course, Constant) or fit.law.chi2 > MAX_SOURCE_CHI2:
        return False
    if by_score(best) < score + REJECTION_MARGIN:
        return False
    rival = rival_score(residual.full_problem, found, residual.forcings[0])
    return rival > score + REJECTION_MARGIN


def map_forcing(
    residual: ResidualForcing, gain: float, located: LocatedSource | None
) -> ForcingMap | None:
    """Return the map of a smooth forcing on the uncorrected simulator.

    Args:
        residual: the free forcings. If they are on top of a law, there is a map only of a source
            along one axis: the forcing then replaces this law.
        gain: evidence for a coarse forcing.
        located: the source that explains the recording; None without one.
    """
    forcing = residual.forcings[0]
    model, levels = forcing.objective.forward_model, forcing.levels
    system = model.simulator.system
    if model.law.count:
        if located is None or len(system.axes) != 1:
            return residual.forcing_map
        levels = tuple(float(field == located.equation) for field in system.fields)
    if not any(levels) or not system.axes:
        return residual.forcing_map
    smooth = fit_smooth_forcing(linearise_fine_forcing(forcing).without_law(), levels)
    return build_smooth_map(smooth, gain)
