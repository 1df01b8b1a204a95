"""What the best law that acts everywhere leaves unexplained, and how clearly."""

from __future__ import annotations

from dataclasses import dataclass, replace

from torch import Tensor

from dashred.discovery.cause import Cause
from dashred.discovery.discovered import MISSING
from dashred.discovery.faults import Fault
from dashred.discovery.forcing_map import ForcingMap, map_of
from dashred.discovery.free_forcing import FreeForcing, force
from dashred.discovery.law import Law
from dashred.discovery.left_out import (
    fault_beneath,
    faulty_or_not,
    forced_without,
    nothing_without,
)
from dashred.discovery.objective import Objective
from dashred.discovery.own_noise import noise_left_by, refitted_under
from dashred.progress import Report

# A law of more candidates may imitate one that acts somewhere only, or is beyond the library; of so
# many, one beyond it, or in a window of the same equations.
SIMPLE = 2
# But one whose every coefficient stands at least so many of its std from none imitates no other.
CERTAIN = 30.0
# Noise this many times as large as under the best law says that a forcing alone has gone astray: it
# cannot steer chaos over a long record.
ASTRAY = 1.2


@dataclass(frozen=True)
class Unexplained:
    """The best law that acts everywhere, and what a free forcing says of it.

    Attributes:
        everything: F of all candidates over the whole record.
        best: the law.
        null: the simulator as it is.
        forced: about whose trajectory further terms are looked for.
        gain: evidence for a free forcing on top of the law.
        unclear: whether anything is left to explain, the law contested, or perhaps an imitation;
            then all fits are under the noise that a free forcing leaves.
        forcing: the map of one on top of the simulator as it is; None where all is clear, or one
            alone goes astray.
        fault: of a sensor, beneath the mismatch: what is forced is without it; None where none is.
    """

    everything: Objective
    best: Cause
    null: Cause
    forced: FreeForcing
    gain: float
    unclear: bool
    forcing: ForcingMap | None = None
    fault: Fault | None = None

    def with_fault(self, laws: list[Cause]) -> list[Cause]:
        """Return laws that were found without a sensor at fault with what is wrong with it."""
        return laws if self.fault is None else faulty_or_not(laws, self.fault.sensor)

    def bases(self) -> list[Cause]:
        """Return what terms may be added to: the law, if there is one, and the simulator as it is.

        Where a sensor is at fault, the simulator alone, fitted without that sensor.
        """
        if self.fault is not None:
            return [nothing_without(self.null, self.forced, self.everything.noise)]
        return [self.best, self.null] if self.best.law.candidates else [self.null]


def look_for_unexplained(
    everything: Objective, best: Cause, null: Cause, contested: bool, size: Tensor, report: Report
) -> Unexplained:
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
    left = Unexplained(everything, best, null, forced, gain, unclear)
    return _looked_into(left, size, report) if unclear else left


def _looked_into(left: Unexplained, size: Tensor, report: Report) -> Unexplained:
    """Return what is unclear with its noise, a fault beneath it, and where to look on."""
    forced, forcing = _carried(left.forced, left.gain, left.best, left.null, size)
    fault = fault_beneath(forced)
    if fault is not None:
        report(0.3, f"a {fault.kind} beneath the mismatch: looking on without that sensor")
        forced = forced_without(forced, fault.sensor)
    noise = noise_left_by(forced)
    return replace(
        left,
        everything=replace(left.everything, noise=noise),
        best=refitted_under(left.best, noise),
        null=refitted_under(left.null, noise),
        forced=forced,
        forcing=forcing,
        fault=fault,
    )


def _carried(
    on_best: FreeForcing, gain: float, best: Cause, null: Cause, size: Tensor
) -> tuple[FreeForcing, ForcingMap | None]:
    """Return a free forcing about whose trajectory to look on, and the map of one.

    That is one on the simulator as it is. Where the best law leaves nothing unexplained, it comes
    nearer to the truth than a forcing, which is as coarse as its cells: unless it is a law of many
    terms, and the forcing leaves less. Where a forcing alone goes astray, the best law carries it,
    and there is no map.
    """
    alone, missing = (on_best, gain) if best is null else force(null.objective, null.phi, size)
    ratio = float((noise_left_by(alone).std / noise_left_by(on_best).std).median())
    if ratio > ASTRAY:
        return on_best, None
    nearer = gain <= MISSING and (len(best.law.candidates) <= SIMPLE or ratio > 1)
    return on_best if nearer else alone, map_of(alone, missing)


def _may_imitate(law: Law) -> bool:
    """Tell whether a law has so many terms that it may be an imitation of another."""
    certain = bool((law.coefficients.abs() >= CERTAIN * law.std).all())
    return len(law.candidates) > SIMPLE and not certain
