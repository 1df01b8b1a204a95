"""Hypotheses of a forcing, a source, a law in a window, and a law beyond the library."""

from __future__ import annotations

from collections.abc import Sequence

from dashred.core.progress import Report
from dashred.inference.fit.law import Law
from dashred.inference.hypotheses.comparison.comparison import Additions
from dashred.inference.hypotheses.comparison.faults_beside_laws import (
    has_neighbouring_faults,
    is_seen_by_one_sensor,
)
from dashred.inference.hypotheses.comparison.fitted_hypotheses import FittedHypotheses
from dashred.inference.hypotheses.comparison.local_and_extended import (
    fit_local_and_extended,
    fit_single_terms,
)
from dashred.inference.hypotheses.comparison.local_source import (
    SourceHypothesis,
    fit_local_source,
)
from dashred.inference.hypotheses.comparison.residual_forcing import (
    MAX_SIMPLE_TERMS,
    ResidualForcing,
    imitates_no_window,
    may_imitate,
)
from dashred.inference.hypotheses.extended.periodic_forcing import fit_periodic_laws
from dashred.inference.hypotheses.free_forcing import fit_free_forcing
from dashred.inference.hypotheses.hypothesis_fit import REJECTION_MARGIN, HypothesisFit
from dashred.inference.hypotheses.result import MAX_EXPLAINED_CHI2


def add_forced_and_local(
    hypotheses: FittedHypotheses,
    residual: ResidualForcing,
    additions: Additions,
    report: Report,
) -> tuple[SourceHypothesis, float]:
    """Add forcings, sources, laws in windows and laws beyond the library.

    Args:
        hypotheses: fits so far, updated.
        residual: the best law and the free forcings on top of it.
        additions: what may be added.
        report: progress.

    Returns:
        The source, and the evidence for a free forcing on top of the best hypothesis.
    """
    base_fits = residual.base_fits()
    if residual.faulty:
        hypotheses.add("the law with sensor faults", lambda: residual.add_faults(base_fits))
    periodic_fits = hypotheses.add(
        "periodic forcings", lambda: _fit_periodic(residual, base_fits, additions)
    )
    source = SourceHypothesis()
    if residual.is_unclear:
        source = hypotheses.budget.attempt(
            "a localised source",
            lambda: fit_local_source(
                residual,
                base_fits[-1],
                hypotheses.leader,
                additions.tendency_rms,
                additions.global_count,
                report,
            ),
            source,
        )
        if source.fits and is_seen_by_one_sensor(source.fits[0], hypotheses.fits):
            source = SourceHypothesis()
        hypotheses.fits += source.fits
    leader = hypotheses.leader
    if leader is not hypotheses.fits[0] and _is_sufficient(leader):
        return source, 0.0
    if source.is_clear:
        _, gain = fit_free_forcing(leader.objective, leader.phi, additions.tendency_rms)
        return source, gain
    if residual.is_unclear:
        more_fits, gain = fit_local_and_extended(
            residual, additions, periodic_fits, hypotheses.budget, report
        )
        hypotheses.fits += more_fits
        return source, gain
    if _may_be_local(residual.best.law):
        where = "beyond the library"
        if not imitates_no_window(residual.best.law):
            where = f"in a window or {where}"
        report(0.4, f"fitting single terms {where}")
        hypotheses.add(f"single terms {where}", lambda: fit_single_terms(residual, additions))
    return source, residual.forcing_gain


def _is_sufficient(leader: HypothesisFit) -> bool:
    """Tell whether a simple hypothesis explains the recording, so that no other terms are needed.

    It has to do so under the noise that a free forcing leaves. A source is compared with laws in a
    window: it may be a term in a region. Neighbouring sensors that err may see a law that acts in a
    region.
    """
    law = leader.law
    is_simple = len(law.candidates) <= MAX_SIMPLE_TERMS and law.source is None
    is_simple = is_simple and not has_neighbouring_faults(leader)
    return is_simple and law.chi2 < MAX_EXPLAINED_CHI2


def _may_be_local(law: Law) -> bool:
    """Tell whether a single term in a window, or one beyond the library, may rival a law."""
    is_local = law.source is not None or law.window is not None
    return is_local or len(law.candidates) == MAX_SIMPLE_TERMS or may_imitate(law)


def _fit_periodic(
    residual: ResidualForcing, base_fits: Sequence[HypothesisFit], additions: Additions
) -> list[HypothesisFit]:
    """Return laws with a forcing that is periodic in time."""
    bound = min(base.law.score for base in base_fits) + REJECTION_MARGIN
    periodic_fits = [
        fit
        for base in base_fits
        for fit in fit_periodic_laws(base, additions.tendency_rms, additions.global_count, bound)
    ]
    return residual.add_faults(periodic_fits)
