"""The first part of a record in which the simulator alone leaves more than noise.

A cause that acts at one place has a handful of unknowns. Over this part it is found with a few
Jacobians, and it is then followed to the end of the record. A fit of all candidates would take most
of the time of a run, because many wrong terms together follow a recording that lacks such a cause.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass

from torch import Tensor

from dashred.inference.fit.least_squares import LeastSquaresProblem
from dashred.inference.fit.levenberg_marquardt import growing_horizon_fits
from dashred.inference.hypotheses.free_forcing import FreeForcing, fit_forcing_nearby
from dashred.inference.hypotheses.result import MAX_EXPLAINED_CHI2

# Smallest share of the record that is searched, and growth factor of the horizon before it.
SHARE, GROWTH = 0.2, 1.5
# Misfit beyond the noise that tells a place from others: causes that differ by less in F are alike.
MIN_EXCESS = 100.0
# A cause that leaves a larger χ²/n has lost the recording.
MAX_CHI2 = 1.5


@dataclass(frozen=True)
class FirstPart:
    """The first part of a record in which something is missing.

    Attributes:
        null: F of the start alone over this part.
        phi: its minimum, ``(mode,)``.
        forcing: a free forcing over this part.
    """

    null: LeastSquaresProblem
    phi: Tensor
    forcing: FreeForcing

    @property
    def samples(self) -> int:
        """Number of samples of this part."""
        return len(self.null.recorded)


def first_parts(
    null: LeastSquaresProblem, phi: Tensor, samples: int, size: Tensor
) -> Iterator[FirstPart]:
    """Yield longer and longer parts; none if the start alone explains the record.

    They end when no forcing follows the recording any longer.

    Args:
        null: F of the start alone over the whole record.
        phi: its fit to the first samples, ``(mode,)``.
        samples: number of these samples.
        size: rms of each equation's own tendency, ``(equation,)``.

    Raises:
        OutOfTimeError: the deadline of F is over.
    """
    for fitted in growing_horizon_fits(null, phi, samples, GROWTH):
        horizon = len(fitted.readings)
        part = null.truncate(horizon)
        # False as well if the misfit is NaN or infinite after a blow-up.
        is_noise = fitted.chi2 < part.noise.count + MIN_EXCESS
        if horizon >= SHARE * len(null.recorded) and not is_noise:
            forcing = fit_forcing_nearby(part, fitted.phi, size)
            if forcing is None:
                return
            yield FirstPart(part, fitted.phi, forcing)


def follows(problem: LeastSquaresProblem, chi2: float) -> bool:
    """Return whether a misfit is near the noise."""
    # Written with "<", because the misfit is NaN or infinite after a blow-up.
    return chi2 < MAX_CHI2 * problem.noise.count


def explains(problem: LeastSquaresProblem, chi2: float) -> bool:
    """Return whether a misfit over the whole record is noise."""
    return chi2 < MAX_EXPLAINED_CHI2 * problem.noise.count
