"""What the best law that acts everywhere leaves unexplained, and how clearly."""

from __future__ import annotations

from dataclasses import dataclass, replace

from torch import Tensor

from dashred.core.progress import Report
from dashred.inference.fit.law import Law
from dashred.inference.fit.least_squares import LeastSquaresProblem
from dashred.inference.hypotheses.comparison.noise_reestimation import noise_left_by, refitted_under
from dashred.inference.hypotheses.forcing_map import ForcingMap, map_of
from dashred.inference.hypotheses.free_forcing import FreeForcing, force
from dashred.inference.hypotheses.hypothesis_fit import HypothesisFit
from dashred.inference.hypotheses.result import MISSING
from dashred.inference.hypotheses.sensors.faults import Fault
from dashred.inference.hypotheses.sensors.leave_one_sensor_out import (
    fault_beneath,
    faulty_or_not,
    forced_without,
    nothing_without,
)

# A law of more candidates may imitate one that acts somewhere only, or is beyond the library; of so
# many, one beyond it, or in a window of the same equations.
SIMPLE = 2
# But one whose every coefficient stands at least so many of its std from none imitates no other.
CERTAIN = 30.0
# Noise this many times as large as under the best law says that a forcing alone has gone astray: it
# cannot steer chaos over a long record.
ASTRAY = 1.2
# And so many times, that nothing found about its trajectory can be trusted.
LOST = 2.0


@dataclass(frozen=True)
class ResidualForcing:
    """The best law that acts everywhere, and what a free forcing says of it.

    Attributes:
        everything: F of all candidates over the whole record.
        best: the law.
        null: the simulator as it is.
        carriers: forcings about whose trajectories further terms are looked for, in this order; the
            last leaves least.
        gain: evidence for a free forcing on top of the law.
        unclear: whether anything is left to explain, the law contested, or perhaps an imitation;
            then all fits are under the noise that a free forcing leaves.
        forcing: the map of one on top of the simulator as it is; None where all is clear, or one
            alone goes astray.
        fault: of a sensor, beneath the mismatch: what is forced is without it; None where none is.
    """

    everything: LeastSquaresProblem
    best: HypothesisFit
    null: HypothesisFit
    carriers: tuple[FreeForcing, ...]
    gain: float
    unclear: bool
    forcing: ForcingMap | None = None
    fault: Fault | None = None

    @property
    def forced(self) -> FreeForcing:
        """The forcing that leaves least."""
        return self.carriers[-1]

    def with_fault(self, laws: list[HypothesisFit]) -> list[HypothesisFit]:
        """Return laws that were found without a sensor at fault with what is wrong with it."""
        return laws if self.fault is None else faulty_or_not(laws, self.fault.sensor)

    def bases(self) -> list[HypothesisFit]:
        """Return what terms may be added to: the law, if there is one, and the simulator as it is.

        Where a sensor is at fault, the simulator alone, fitted without that sensor.
        """
        if self.fault is not None:
            return [nothing_without(self.null, self.forced, self.everything.noise)]
        return [self.best, self.null] if self.best.law.candidates else [self.null]


def fit_residual_forcing(
    everything: LeastSquaresProblem,
    best: HypothesisFit,
    null: HypothesisFit,
    contested: bool,
    size: Tensor,
    report: Report,
) -> ResidualForcing:
    """Return what a free forcing on top of a law explains; look into it where that is not clear.

    Args:
        everything: F of all candidates over the whole record.
        best: the best law that acts everywhere.
        null: the simulator as it is.
        contested: whether another law that acts everywhere does as well as the best.
        size: rms of each equation's own tendency, ``(equation,)``.
        report: progress.
    """
    forced, gain = force(best.objective, best.phi, size)
    report(0.2, f"a free forcing gains {gain:.0f}")
    unclear = gain > MISSING or contested or _may_imitate(best.law)
    left = ResidualForcing(everything, best, null, (forced,), gain, unclear)
    return _looked_into(left, size, report) if unclear else left


def _looked_into(left: ResidualForcing, size: Tensor, report: Report) -> ResidualForcing:
    """Return what is unclear with its noise, a fault beneath it, and where to look on."""
    carriers, forcing = _carried(left.forced, left.gain, left.best, left.null, size)
    fault = fault_beneath(carriers[-1])
    if fault is not None:
        report(0.3, f"a {fault.kind} beneath the mismatch: looking on without that sensor")
        carriers = tuple(forced_without(forced, fault.sensor) for forced in carriers)
    noise = noise_left_by(carriers[-1])
    return replace(
        left,
        everything=replace(left.everything, noise=noise),
        best=refitted_under(left.best, noise),
        null=refitted_under(left.null, noise),
        carriers=carriers,
        forcing=forcing,
        fault=fault,
    )


def _carried(
    on_best: FreeForcing, gain: float, best: HypothesisFit, null: HypothesisFit, size: Tensor
) -> tuple[tuple[FreeForcing, ...], ForcingMap | None]:
    """Return the forcings about whose trajectories to look on, and the map of one.

    That is one on the simulator as it is. Where the best law leaves nothing unexplained, it comes
    nearer to the truth than a forcing, which is as coarse as its cells; and where a forcing alone
    goes astray, the best law carries it, and there is no map. But a law of many terms may come
    near to the sensors and take a hidden field far from the truth: then both are asked.
    """
    alone, missing = (on_best, gain) if best is null else force(null.objective, null.phi, size)
    ratio = float((noise_left_by(alone).std / noise_left_by(on_best).std).median())
    forcing = map_of(alone, missing) if ratio <= ASTRAY else None
    many = len(best.law.candidates) > SIMPLE
    if ratio <= ASTRAY and (gain > MISSING or (many and ratio <= 1)):
        return (alone,), forcing
    return ((alone, on_best) if many and ratio < LOST else (on_best,)), forcing


def _may_imitate(law: Law) -> bool:
    """Tell whether a law has so many terms that it may be an imitation of another."""
    certain = bool((law.coefficients.abs() >= CERTAIN * law.std).all())
    return len(law.candidates) > SIMPLE and not certain
