"""What discovery found: the law, its rivals, and how sure."""

from __future__ import annotations

from dataclasses import dataclass

from torch import Tensor

from dashred.inference.fit.law import Law
from dashred.inference.fit.noise_model import NoiseModel
from dashred.inference.forward.candidates import Candidate
from dashred.inference.hypotheses.forcing_map import ForcingMap

# Evidence that a free forcing has to gain for something to be missing
# (docs/method.md#repeated-screening).
MISSING = 4.0
# A rival within this of the best is as good as the best (docs/method.md#ambiguity-and-convergence).
AMBIGUOUS = 6.0


@dataclass(frozen=True)
class BestOfSize:
    """The best law of so many candidates, everywhere.

    Attributes:
        candidates: these.
        coefficients: of each.
        score: lower is better.
        rmse: root of F per reading, in σ.
    """

    candidates: tuple[Candidate, ...]
    coefficients: tuple[float, ...]
    score: float
    rmse: float


@dataclass(frozen=True)
class Discovery:
    """The findings of the refinement, before anything held out was looked at.

    Attributes:
        laws: the best law and its rivals, the best first; each fitted to the end.
        nothing: the simulator as it is, with its own best start.
        noise: what the best law's residuals speak for.
        first_guesses: RMSE on the validation sensors in σ after the first window, by first guess
            of the start.
        first_guess: the one that was used.
        levels: ``(samples, χ²/n)`` along the growing horizon.
        reached: whether the horizon grew to the whole fit window.
        free_chi2: χ²/n of the fit of all candidates together, under the same noise.
        exhausted: whether the swap search ran to its end.
        path: the best law of each size, the smallest first.
        tried: how many sets were refitted.
        forcing_gain: evidence for a free forcing on top of the best law.
        forcing: the map of a free forcing on top of the simulator as it is, where one was needed.
    """

    laws: list[Law]
    nothing: Law
    noise: NoiseModel
    first_guesses: dict[str, float]
    first_guess: str
    levels: list[tuple[int, float]]
    reached: bool
    free_chi2: float
    exhausted: bool
    path: list[BestOfSize]
    tried: int
    forcing_gain: float = 0.0
    forcing: ForcingMap | None = None

    @property
    def best(self) -> Law:
        """The law with the lowest score."""
        return self.laws[0]

    @property
    def on_path(self) -> int | None:
        """Which law of the path has the terms that are reported; None where none has.

        Another cause may have been weighed against the path's laws, and a law in a window is none
        of them.
        """
        reported = self.best.keys
        sets = [frozenset(each.key for each in of_size.candidates) for of_size in self.path]
        return sets.index(reported) if self.best.window is None and reported in sets else None

    @property
    def rivals(self) -> list[Law]:
        """The laws within ΔBIC 6 of the best that it does not contain, nor they it.

        A superset counts, too, unless the search ran to its end.
        """
        mine = self.best.parts
        found = []
        for law in self.laws[1:]:
            theirs = law.parts
            # Of one cause in two sizes, as of a start, neither is a rival of the other.
            nested = theirs <= mine or (self.exhausted and theirs > mine)
            if law.score < self.best.score + AMBIGUOUS and not nested:
                found.append(law)
        return found


@dataclass(frozen=True)
class Trajectories:
    """Free runs over the recording's clock and beyond: of three starts and two laws.

    Attributes:
        times: the recording's samples, ``(time,)``; then half as many again.
        same_start: the uncorrected simulator from the best law's start, ``(time, field, *grid)``.
        refit: the uncorrected simulator from its own best start.
        corrected: the best law from its start.
    """

    times: Tensor
    same_start: Tensor
    refit: Tensor
    corrected: Tensor
