"""A law: a set of candidates with coefficients, fitted together with the start."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import torch
from torch import Tensor

from dashred.core.formatting import Z95
from dashred.inference.fit.located_source import LocatedSource
from dashred.inference.forward.candidates import Candidate, build_forcing
from dashred.physics.solvers.forcing import Forcing
from dashred.physics.window import Window

# A start that is this probable under its stated prior is not told as another start.
MAX_START_CHANCE = 0.01
# Kinds of faults that are special cases of another kind.
SPECIAL_CASES = {"wandering": ("bias", "drift")}


@dataclass(frozen=True)
class ErrorCurve:
    """The error of a sensor's readings over one episode.

    Attributes:
        times: times of the curve.
        value: the error at these times, in the unit of the readings.
        std: its posterior standard deviation.
        episode: index of the episode, from 0.
    """

    times: tuple[float, ...]
    value: tuple[float, ...]
    std: tuple[float, ...]
    episode: int = 0


@dataclass(frozen=True)
class SensorFault:
    """A fault of one sensor.

    Attributes:
        kind: a key of :data:`dashred.core.findings.fault_kinds.FAULT_KINDS`.
        sensor: its name.
        value: see :class:`dashred.core.findings.fault_kinds.FaultKind`.
        std: posterior standard deviation of ``value``; None for a count.
        begin: time from which the sensor is stuck; None for the other kinds.
        episode: index of the episode with the fault, from 0; None for all episodes.
        curves: the error of a wandering sensor in every episode; empty for the other kinds.
    """

    kind: str
    sensor: str
    value: float
    std: float | None
    begin: float | None
    episode: int | None = None
    curves: tuple[ErrorCurve, ...] = ()

    @property
    def parts(self) -> frozenset[str]:
        """The fault, and the plainer faults that are special cases of it."""
        kinds = (self.kind, *SPECIAL_CASES.get(self.kind, ()))
        return frozenset(f"{kind} of {self.sensor}" for kind in kinds)

    def offset(self, elapsed: Tensor) -> Tensor | None:
        """Return the error of the readings at times after the first sample, ``(time,)``.

        None for a fault that does not predict an error: the readings are left out.
        """
        match self.kind:
            case "bias":
                return torch.full_like(elapsed, self.value)
            case "drift":
                return self.value * elapsed
        return None


@dataclass(frozen=True)
class FittedParameter:
    """An uncertain parameter, fitted beside the law.

    Attributes:
        candidate: the parameter, with its prior.
        change: from the value in the system, as the coefficient ξ of its tangent.
        std: posterior standard deviation of ``change``.
    """

    candidate: Candidate
    change: float
    std: float


@dataclass(frozen=True)
class Law:
    """One explanation of the recording.

    Attributes:
        candidates: missing terms and changed parameters; empty for the unchanged simulator.
        coefficients: ξ, ``(candidate,)``, in the user's units.
        covariance: posterior covariance of ξ, including the uncertainty of the start.
        start: states at the first sample, ``(episode, field, *grid)``.
        score: ``F + k (ln n + 2 ln p)``; differences are ΔBIC.
        chi2: mean squared whitened residual of the fit; 1 for noise alone.
        residuals: readings minus recording, ``(time, sensor)``; NaN where missing.
        edges: posterior std of the window's unknowns; empty without a window.
        threshold: 95 % interval of the threshold of a window in a field; None without such a
            window, or where only the std is known.
        faults: faults of sensors, in addition to the law, at most one of each sensor.
        start_prior_factor: factor by which the prior of the start is widened; 1 for the stated
            prior.
        start_chance: if it is widened, the probability that a start of the stated prior deviates as
            much from its mean.
        source: the localised source that its terms express; None for other laws.
        parameters: uncertain parameters, fitted beside it.
    """

    candidates: tuple[Candidate, ...]
    coefficients: Tensor
    covariance: Tensor
    start: Tensor
    score: float
    chi2: float
    residuals: Tensor
    edges: tuple[float, ...] = ()
    threshold: tuple[float, float] | None = None
    faults: tuple[SensorFault, ...] = ()
    start_prior_factor: float = 1.0
    start_chance: float = 0.0
    source: LocatedSource | None = None
    parameters: tuple[FittedParameter, ...] = ()

    @property
    def std(self) -> Tensor:
        """Posterior standard deviations, ``(candidate,)``."""
        return self.covariance.diagonal().clamp(min=0).sqrt()

    @property
    def parameter_changes(self) -> Tensor:
        """Changes of the uncertain parameters, ``(parameter,)``."""
        return torch.tensor([each.change for each in self.parameters], dtype=torch.float64)

    @property
    def changes(self) -> tuple[tuple[Candidate, ...], Tensor]:
        """The uncertain parameters, then the terms of the law, each with its coefficient."""
        parameters = tuple(each.candidate for each in self.parameters)
        coefficients = torch.cat([self.parameter_changes, self.coefficients])
        return (*parameters, *self.candidates), coefficients

    @property
    def keys(self) -> frozenset[str]:
        """Keys of the candidates, without windows, faults and the start."""
        return frozenset(candidate.key for candidate in self.candidates)

    @property
    def parts(self) -> frozenset[str]:
        """Everything that the law changes in the simulator; empty for the empty law.

        A law with fewer parts is nested in one with more. A term that acts everywhere is nested in
        the same term in a window. A parameter counts as the term that it replaces.
        """
        found = {
            candidate.replaces[0] if candidate.replaces else candidate.key
            for candidate in self.candidates
        }
        if self.window is not None:
            found.add(f"in a {self.window.shape.kind} of {self.window.shape.of}")
        if self.source is not None:
            found = set(self.source.parts)
        return frozenset(found).union(self._start_parts, *(fault.parts for fault in self.faults))

    @property
    def has_other_start(self) -> bool:
        """Whether the start lies outside of its stated prior."""
        return self.start_prior_factor > 1 and self.start_chance < MAX_START_CHANCE

    @property
    def _start_parts(self) -> list[str]:
        return ["start outside of its prior"] if self.has_other_start else []

    @property
    def is_extended(self) -> bool:
        """Whether it has terms that are not in the library."""
        return any(candidate.is_extended for candidate in self.candidates)

    @property
    def window(self) -> Window | None:
        """The window of its local terms; None if all act everywhere."""
        return next((c.window for c in self.candidates if c.window is not None), None)

    def interval(self, index: int) -> tuple[float, float]:
        """Return the 95 % interval of one coefficient."""
        value, std = float(self.coefficients[index]), float(self.std[index])
        return value - Z95 * std, value + Z95 * std

    def forcing(self) -> Forcing | None:
        """Return the model error for the simulator; None for the empty law."""
        if not self.candidates:
            return None
        return build_forcing(self.candidates, self.coefficients[None])

    def __str__(self) -> str:
        """``u: 0.0249*u - 0.0251*u**3``; ``nothing`` for the empty law."""
        parts = [
            f"{candidate} × {value:.4g}"
            for candidate, value in zip(self.candidates, self.coefficients.tolist(), strict=True)
        ]
        faults = [f"{fault.kind} of {fault.sensor}" for fault in self.faults]
        return ", ".join([*parts, *faults, *self._start_parts]) or "nothing"


def distinct_laws(laws: Sequence[Law]) -> list[Law]:
    """Return the best law of each form, in the order of their scores.

    Laws have the same form if they have the same candidates, in windows of the same kind, and the
    same faults.
    """
    kept: dict[object, Law] = {}
    for law in sorted(laws, key=lambda law: law.score):
        kept.setdefault(_form(law), law)
    return list(kept.values())


def _form(law: Law) -> object:
    parts = tuple(sorted(_form_of(candidate) for candidate in law.candidates))
    faults = frozenset((fault.kind, fault.sensor) for fault in law.faults)
    return parts, faults, law.start_prior_factor


def _form_of(candidate: Candidate) -> tuple[str, str, str]:
    window = candidate.window
    return candidate.key, *((window.shape.kind, window.shape.of) if window else ("", ""))
