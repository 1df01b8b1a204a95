"""The hypotheses that have been fitted, and those for which there was no time."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field

from dashred.core.budget import Budget
from dashred.inference.hypotheses.hypothesis_fit import HypothesisFit, by_score


@dataclass
class FittedHypotheses:
    """Fits of hypotheses, to which further ones are added.

    Attributes:
        budget: gets the names of the hypotheses for which there is no time.
        fits: the fits, in the order in which they were made.
    """

    budget: Budget
    fits: list[HypothesisFit] = field(default_factory=list)

    @property
    def leader(self) -> HypothesisFit:
        """The fit with the lowest score."""
        return min(self.fits, key=by_score)

    @property
    def uncorrected(self) -> HypothesisFit:
        """The best fit of the simulator as it is."""
        return min((fit for fit in self.fits if not fit.law.parts), key=by_score)

    def add(self, name: str, fit: Callable[[], list[HypothesisFit]]) -> list[HypothesisFit]:
        """Add the fits of a kind of hypotheses, if there is time, and return them.

        Args:
            name: what is told if there is no time.
            fit: returns the fits.
        """
        nothing: list[HypothesisFit] = []
        found = self.budget.attempt(name, fit, nothing)
        self.fits += found
        return found

    def replace_all(
        self, name: str, fit: Callable[[list[HypothesisFit]], list[HypothesisFit]]
    ) -> None:
        """Replace all fits by others of the same hypotheses, if there is time.

        Args:
            name: what is told if there is no time.
            fit: returns the new fits.
        """
        self.fits = self.budget.attempt(name, lambda: fit(self.fits), self.fits)
