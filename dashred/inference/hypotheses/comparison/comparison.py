"""What hypotheses may add to the simulator, and the result of their comparison."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass

from torch import Tensor

from dashred.inference.fit.law import Law
from dashred.inference.fit.located_source import LocatedSource
from dashred.inference.fit.noise_model import NoiseModel
from dashred.inference.forward.candidates import Candidate
from dashred.inference.forward.simulator import Simulator
from dashred.inference.hypotheses.forcing_map import ForcingMap


@dataclass(frozen=True)
class Additions:
    """What may be added to the simulator.

    Attributes:
        global_count: number of candidates that may act everywhere; these come first.
        tendency_rms: rms of each equation's own tendency, ``(equation,)``.
        windowed_simulator: builds the simulator with windows, which takes seconds to compile.
        extended_candidates: builds the terms beyond the library.
    """

    global_count: int
    tendency_rms: Tensor
    windowed_simulator: Callable[[], Simulator]
    extended_candidates: Callable[[], Sequence[Candidate]]


@dataclass(frozen=True)
class Comparison:
    """All hypotheses, scored under the same noise.

    Attributes:
        laws: the laws, the best first.
        uncorrected: the uncorrected simulator with its own best initial state.
        noise: the noise under which they were scored.
        forced_noise: the noise that a free forcing leaves.
        forcing_gain: evidence for a free forcing on top of the best law.
        forcing_map: the map of a forcing on top of the uncorrected simulator; None if the best law
            is clear, if nothing is missing, or if no forcing can be fitted.
        source: the localised source that the best law expresses, or that explains most of the
            misfit where no law does; None without one.
        is_cut_short: whether the time sufficed for sensor faults only. What the best law leaves
            unexplained is then not known.
    """

    laws: list[Law]
    uncorrected: Law
    noise: NoiseModel
    forced_noise: NoiseModel
    forcing_gain: float
    forcing_map: ForcingMap | None
    source: LocatedSource | None = None
    is_cut_short: bool = False
