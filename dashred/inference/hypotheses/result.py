"""The result of the discovery: the law, its rivals, and the evidence."""

from __future__ import annotations

from dataclasses import dataclass

from dashred.inference.fit.law import Law
from dashred.inference.fit.located_source import LocatedSource
from dashred.inference.fit.noise_model import NoiseModel
from dashred.inference.fit.selection.nested_fits import RoomLeft
from dashred.inference.forward.candidates import Candidate
from dashred.inference.hypotheses.forcing_map import ForcingMap

# If a free forcing gains more evidence than this, something is missing
# (docs/method.md#repeated-screening).
MIN_FORCING_GAIN = 4.0
# A rival within this score difference is as good as the best law
# (docs/method.md#ambiguity-and-convergence).
AMBIGUITY_MARGIN = 6.0
# Below this χ²/n a hypothesis explains what it is fitted to.
MAX_EXPLAINED_CHI2 = 1.1


@dataclass(frozen=True)
class BestOfSize:
    """The best law with a given number of candidates that act everywhere.

    Attributes:
        candidates: the candidates of the law.
        coefficients: their coefficients.
        score: lower is better.
        rmse: root of F per reading, in σ.
    """

    candidates: tuple[Candidate, ...]
    coefficients: tuple[float, ...]
    score: float
    rmse: float


@dataclass(frozen=True)
class Discovery:
    """The result of the discovery. It uses no held-out data.

    Attributes:
        laws: the best law and its rivals, the best first; each fitted until convergence.
        uncorrected: the uncorrected simulator with its own best initial state.
        noise: the noise estimated from the residuals of the best law.
        first_guesses: RMSE on the validation sensors in σ after the first window, by first guess
            of the initial state.
        first_guess: the first guess that was used.
        levels: ``(samples, χ²/n)`` along the growing horizon.
        is_horizon_complete: whether the horizon grew to the whole fit window.
        free_chi2: χ²/n of the fit of all candidates together, under the same noise.
        is_search_complete: whether the swap search ended by itself.
        path: the best law of each size, the smallest first.
        refit_count: number of candidate sets that were refitted.
        forcing_gain: evidence for a free forcing on top of the best law.
        forcing_map: the map of a free forcing on top of the uncorrected simulator; None if none was
            needed.
        also_supported: terms that the evidence supports beside the best law, with their
            coefficients, and that its forecast does not need.
        source: a localised source; None without one.
        room_left: what the fit of the best law could still gain; None if it is not known.
    """

    laws: list[Law]
    uncorrected: Law
    noise: NoiseModel
    first_guesses: dict[str, float]
    first_guess: str
    levels: list[tuple[int, float]]
    is_horizon_complete: bool
    free_chi2: float
    is_search_complete: bool
    path: list[BestOfSize]
    refit_count: int
    forcing_gain: float = 0.0
    forcing_map: ForcingMap | None = None
    also_supported: tuple[tuple[Candidate, float], ...] = ()
    source: LocatedSource | None = None
    room_left: RoomLeft | None = None

    @property
    def best(self) -> Law:
        """The law with the lowest score."""
        return self.laws[0]

    @property
    def path_index(self) -> int | None:
        """Index of the reported law in the path; None if it is not in the path.

        Another hypothesis may have won, and a law in a window is never in the path.
        """
        reported = self.best.keys
        sets = [frozenset(each.key for each in of_size.candidates) for of_size in self.path]
        return sets.index(reported) if self.best.window is None and reported in sets else None

    @property
    def rivals(self) -> list[Law]:
        """The laws within ΔBIC 6 of the best that are neither subsets nor supersets of it.

        A superset counts as a rival if the search is not complete.
        """
        best_parts = self.best.parts
        rivals = []
        for law in self.laws[1:]:
            parts = law.parts
            # One hypothesis with two values, such as two factors of a prior, is no rival of itself.
            is_nested = parts <= best_parts or (self.is_search_complete and parts > best_parts)
            if law.score < self.best.score + AMBIGUITY_MARGIN and not is_nested:
                rivals.append(law)
        return rivals
