"""What the best global law leaves unexplained, measured by a free forcing."""

from __future__ import annotations

import math
from dataclasses import dataclass, replace

from torch import Tensor

from dashred.core.progress import Report
from dashred.inference.fit.law import Law
from dashred.inference.fit.least_squares import LeastSquaresProblem
from dashred.inference.hypotheses.comparison.noise_reestimation import (
    estimate_noise_under_forcing,
    refit_under_noise,
)
from dashred.inference.hypotheses.forcing_map import ForcingMap, build_forcing_map
from dashred.inference.hypotheses.free_forcing import FreeForcing, fit_free_forcing
from dashred.inference.hypotheses.hypothesis_fit import HypothesisFit
from dashred.inference.hypotheses.result import MIN_FORCING_GAIN
from dashred.inference.hypotheses.sensors.excluded_sensors import (
    add_faults_or_refit,
    find_faults_beside_forcing,
    refit_forcing_without_sensors,
    refit_simulator_without_sensors,
)
from dashred.inference.hypotheses.sources.smooth_forcing import (
    fit_smooth_forcing,
    linearise_fine_forcing,
)

# A law with more terms may imitate a law in a window or beyond the library. A law with just as many
# may imitate a law beyond the library or a law in a window of the same equations.
MAX_SIMPLE_TERMS = 2
# A law of more terms whose coefficients are all at least this many standard deviations from zero is
# no imitation. One of fewer terms may imitate a function beyond the library, but no window.
MIN_COEFFICIENT_RATIO = 30.0
# If a forcing alone leaves this many times the noise of a forcing on the best law, it has lost the
# recording: it cannot steer chaos over a long record.
MAX_NOISE_RATIO = 1.2
# If a coarse forcing leaves a larger χ²/n, a finer one replaces it.
MAX_COARSE_CHI2 = 1.5
# If it leaves this many times the noise, its trajectory is not used at all.
LOST_NOISE_RATIO = 2.0


@dataclass(frozen=True)
class ResidualForcing:
    """The best global law, and the free forcings on top of it.

    Attributes:
        full_problem: F of all candidates over the whole record.
        best: the best law that acts everywhere.
        null: the uncorrected simulator.
        forcings: free forcings; terms are searched about their trajectories in this order. The last
            one has the smallest residual.
        forcing_gain: evidence for a free forcing on top of the law.
        is_unclear: True if something is unexplained, or if the law has rivals or may imitate
            another law. All fits then use the noise that a free forcing leaves.
        forcing_map: the map of a forcing on top of the uncorrected simulator; None if that is not
            fitted, is zero, or loses the recording.
        faulty: columns of sensors whose faults the forcings do not explain; they are fitted without
            these sensors.
        forcing_alone: a forcing on top of the uncorrected simulator, fitted to all sensors; None if
            none was needed (:func:`add_forcing_alone`).
    """

    full_problem: LeastSquaresProblem
    best: HypothesisFit
    null: HypothesisFit
    forcings: tuple[FreeForcing, ...]
    forcing_gain: float
    is_unclear: bool
    forcing_map: ForcingMap | None = None
    faulty: tuple[int, ...] = ()
    forcing_alone: FreeForcing | None = None

    @property
    def is_simple(self) -> bool:
        """Whether a law of few terms leaves nothing that a forcing explains."""
        few = len(self.best.law.candidates) <= MAX_SIMPLE_TERMS
        return few and self.forcing_gain <= MIN_FORCING_GAIN

    @property
    def best_forcing(self) -> FreeForcing:
        """The forcing with the smallest residual."""
        return self.forcings[-1]

    def add_faults(self, laws: list[HypothesisFit]) -> list[HypothesisFit]:
        """Return laws that were fitted without the faulty sensors, with their faults added."""
        return add_faults_or_refit(laws, self.faulty) if self.faulty else laws

    def base_fits(self) -> list[HypothesisFit]:
        """Return the fits to which terms may be added: the law, if any, and the null.

        If sensors are at fault, only the null is returned, fitted without these sensors.
        """
        if self.faulty:
            noise = self.full_problem.noise
            return [refit_simulator_without_sensors(self.null, self.best_forcing, noise)]
        return [self.best, self.null] if self.best.law.candidates else [self.null]


def fit_residual_forcing(
    full_problem: LeastSquaresProblem,
    best: HypothesisFit,
    null: HypothesisFit,
    has_rivals: bool,
    tendency_rms: Tensor,
    report: Report,
) -> ResidualForcing:
    """Fit a free forcing on top of the best law; examine further what remains unclear.

    Args:
        full_problem: F of all candidates over the whole record.
        best: the best law that acts everywhere.
        null: the uncorrected simulator.
        has_rivals: whether another law that acts everywhere does as well as the best. One that
            contains the best law is no other explanation.
        tendency_rms: rms of each equation's own tendency, ``(equation,)``.
        report: progress.
    """
    forcing, gain = fit_free_forcing(best.objective, best.phi, tendency_rms)
    report(0.2, f"evidence for a free forcing: {gain:.0f}")
    is_unclear = gain > MIN_FORCING_GAIN or has_rivals or may_imitate(best.law)
    alone = forcing if best is null else None
    residual = ResidualForcing(
        full_problem, best, null, (forcing,), gain, is_unclear, forcing_alone=alone
    )
    return _resolve_unclear(residual, tendency_rms, report) if is_unclear else residual


def _resolve_unclear(
    residual: ResidualForcing, tendency_rms: Tensor, report: Report
) -> ResidualForcing:
    """Return an unclear case with its forcings, their noise, and the faulty sensors."""
    forcings = residual.forcings
    # The forcing on a simple law is closer to the truth than a forcing alone, which is as coarse as
    # its cells.
    if not residual.is_simple:
        residual = add_forcing_alone(residual, tendency_rms)
        forcings = _choose_forcings(residual)
    forcings = tuple(_finer(forcing) for forcing in forcings)
    faults = find_faults_beside_forcing(forcings[-1]).faults
    faulty = tuple(fault.sensor for fault in faults)
    if faulty:
        kinds = ", ".join(fault.kind for fault in faults)
        report(0.3, f"sensor faults ({kinds}): continuing without these sensors")
        forcings = tuple(refit_forcing_without_sensors(each, faulty) for each in forcings)
    noise = estimate_noise_under_forcing(forcings[-1])
    return replace(
        residual,
        full_problem=replace(residual.full_problem, noise=noise),
        best=refit_under_noise(residual.best, noise),
        null=refit_under_noise(residual.null, noise),
        forcings=forcings,
        faulty=faulty,
    )


def _finer(forcing: FreeForcing) -> FreeForcing:
    """Return a smooth forcing on a fine mesh if a coarse one leaves far more than noise.

    Such residuals are correlated in time. An estimate of the noise from them would hide the
    misfit of any hypothesis, and they would look like a fault of a sensor.
    """
    system = forcing.objective.forward_model.simulator.system
    if not system.axes or _misfit(forcing) < MAX_COARSE_CHI2 or not any(forcing.levels):
        return forcing
    smooth = fit_smooth_forcing(linearise_fine_forcing(forcing), forcing.levels).forcing
    return min(forcing, smooth, key=_misfit)


def _misfit(forcing: FreeForcing) -> float:
    """Return χ²/n of a forcing; infinite if its trajectory blows up."""
    normal, count = forcing.normal, forcing.objective.noise.count
    return float(normal.residuals.square().sum()) / count if normal.is_finite else math.inf


def add_forcing_alone(residual: ResidualForcing, tendency_rms: Tensor) -> ResidualForcing:
    """Return the case with a forcing on the null and its map.

    Args:
        residual: the case.
        tendency_rms: rms of each equation's own tendency, ``(equation,)``.

    Raises:
        OutOfTimeError: the deadline of F is over.
    """
    forcing, gain, null = residual.forcing_alone, residual.forcing_gain, residual.null
    if forcing is None:
        forcing, gain = fit_free_forcing(null.objective, null.phi, tendency_rms)
    residual = replace(residual, forcing_alone=forcing)
    follows = _noise_ratio(residual) <= MAX_NOISE_RATIO
    return replace(residual, forcing_map=build_forcing_map(forcing, gain) if follows else None)


def _noise_ratio(residual: ResidualForcing) -> float:
    """Return the noise that a forcing on the null leaves, in that of one on the best law."""
    assert residual.forcing_alone is not None
    alone = estimate_noise_under_forcing(residual.forcing_alone)
    on_best = estimate_noise_under_forcing(residual.best_forcing)
    return float((alone.std / on_best.std).median())


def _choose_forcings(residual: ResidualForcing) -> tuple[FreeForcing, ...]:
    """Return the forcings to search about.

    This is the forcing on the null if it follows the recording about as well as the one on the best
    law, and something is unexplained. A law of many terms that leaves nothing may fit the sensors
    and take a hidden field far from the truth: the forcing on the null is used alone if it leaves
    no more noise, and beside the other one if it leaves less than LOST_NOISE_RATIO times the noise.
    """
    alone, ratio = residual.forcing_alone, _noise_ratio(residual)
    assert alone is not None
    if ratio <= (MAX_NOISE_RATIO if residual.forcing_gain > MIN_FORCING_GAIN else 1):
        return (alone,)
    if len(residual.best.law.candidates) > MAX_SIMPLE_TERMS and ratio < LOST_NOISE_RATIO:
        return alone, residual.best_forcing
    return (residual.best_forcing,)


def may_imitate(law: Law) -> bool:
    """Tell whether a law has many terms, not all certain, so that it may imitate another law.

    The terms of a source are the parts of its course.
    """
    return law.source is None and len(law.candidates) > MAX_SIMPLE_TERMS and not is_certain(law)


def imitates_no_window(law: Law) -> bool:
    """Tell whether a law that acts everywhere is too certain to imitate a term in a window."""
    return law.source is None and law.window is None and is_certain(law)


def is_certain(law: Law) -> bool:
    """Tell whether all coefficients of a law are far from zero."""
    return bool((law.coefficients.abs() >= MIN_COEFFICIENT_RATIO * law.std).all())
