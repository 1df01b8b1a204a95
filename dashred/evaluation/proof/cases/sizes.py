"""Find the size of a hidden effect from its effect on the sensors."""

from __future__ import annotations

import copy
from collections.abc import Callable
from dataclasses import dataclass
from functools import cached_property
from typing import Any

import torch
from torch import Tensor

from dashred.config import Config
from dashred.core.errors import InputError
from dashred.data.observation_operator import ObservationOperator
from dashred.data.recording import Recording
from dashred.data.sensor_layout import place_sensors
from dashred.data.sensors import Sensor
from dashred.data.splits import split_recording
from dashred.evaluation.proof.cases.draw import Case
from dashred.evaluation.proof.cases.systems import SYSTEMS
from dashred.evaluation.twins.recorder import (
    coarsen,
    draw_start,
    run_truth,
    true_system,
    truth_times,
)
from dashred.evaluation.twins.twin_file import Twin, parse_twin
from dashred.physics.solvers.simulate import simulate
from dashred.physics.system import System, Term
from dashred.physics.terms.library import evaluate_terms

# Sizes as a share of the tendency of an equation, or of the value of a parameter: the start of the
# search and the largest size.
INITIAL_SIZE, MAX_SIZE = 0.03, 0.5
ROUNDS, TOLERANCE = 6, 0.2
# Largest difference of the true and the simulated readings, as a share of the std of a trace.
MAX_DIFFERENCE = 0.7
# Size at which the effect of a law or a parameter is approximately linear.
LINEAR_SIZE = 0.01
# Range of the displacement of a sensor, as a share of the axis.
MIN_DISPLACEMENT, MAX_DISPLACEMENT = 0.0025, 0.03
# Size of a spike beyond its effect, in standard deviations, to exceed occasional noise.
SPIKE_OFFSET = 6.0


@dataclass(frozen=True)
class Sizes:
    """The start, sensors and clock of a case, on which sizes are tried."""

    case: Case
    system: System
    config: Config
    start: Tensor
    times: Tensor
    recorded: int
    sensors: list[Sensor]
    plain: Tensor

    @classmethod
    def of(cls, case: Case, system: System, config: Config) -> Sizes:
        """Draw the start and the sensor positions; run the unchanged simulator."""
        times = truth_times(config)
        recorded = int((times <= config.recording.duration * (1 + 1e-9)).sum())
        spread = {"terms": [], "spread": case.hidden.get("spread", 1.0)}
        only_start = parse_twin(str(case), spread, str(case), config)
        start = draw_start(system, system, only_start, config, case.stream("start"))
        sensors = place_sensors(system, config, case.stream("read"))
        plain = run_truth(system, start, times[:recorded])
        return cls(case, system, config, start, times, recorded, sensors, plain)

    def twin(self, entry: dict[str, Any]) -> Twin:
        """Return the twin of an entry."""
        return parse_twin(str(self.case), entry, str(self.case), self.config)

    def fitting_size(self, case: Case) -> tuple[float, float | None]:
        """Return the size of the hidden effect and its rms at the sensors in σ.

        Raises:
            InputError: no size that was tried could be simulated.
        """
        if case.share is not None:
            return case.share, self.effect(case.hidden, case.share)
        assert case.effect is not None
        wanted = min(case.effect, MAX_DIFFERENCE / case.noise)
        return _search(lambda size: self.effect(case.hidden, size), wanted)

    def effect(self, hidden: dict[str, Any], size: float) -> float | None:
        """Return the rms change of the readings due to a hidden law, in σ; None if it blows up."""
        try:
            return float(self._reading_change(self.sized(hidden, size)).square().mean().sqrt())
        except InputError:
            return None

    def numerical_error(self, true_law_system: System, truth: Tensor) -> float:
        """Return χ² of the simulator's run with the true law and start against the truth.

        Args:
            true_law_system: the true system, at the simulator's resolution.
            truth: the truth at doubled resolution, ``(time, field, *grid)``.
        """
        own = simulate(true_law_system, coarsen(self.start), self.times[: self.recorded])[0]
        error = (self._operator(own) - self._operator(truth)) / self._sigma
        return float(error.square().sum().nan_to_num(torch.inf))

    def sized(self, hidden: dict[str, Any], size: float) -> dict[str, Any]:
        """Return the entry with absolute coefficients, parameters and faults."""
        entry = copy.deepcopy(hidden)
        for term in entry["terms"]:
            share = size * term["coefficient"] * self._scale(term["equation"], term["term"])
            term["coefficient"] = float(f"{share:.3g}")
        known = self.config.system.parameters
        shares = entry.get("parameters", {})
        if name := entry.pop("masked_by", None):
            shares = {name: self._compensation}
        if shares:
            entry["parameters"] = {
                name: float(f"{known[name] * (1 + share * size):.4g}")
                for name, share in shares.items()
            }
        entry["faults"] = [self._fault(fault) for fault in entry.get("faults", [])]
        return entry

    @cached_property
    def _compensation(self) -> float:
        """Return the change of a parameter, per size of the law, that best compensates the law.

        ``−r·p/p·p``: least squares, with r and p the reading changes due to law and parameter.
        """
        law = {"terms": self.case.hidden["terms"]}
        parameter = {"terms": [], "parameters": {self.case.hidden["masked_by"]: 1.0}}
        r, p = (self._reading_change(self.sized(entry, LINEAR_SIZE)) for entry in (law, parameter))
        return -float((r * p).sum() / p.square().sum())

    def _reading_change(self, entry: dict[str, Any]) -> Tensor:
        """Return the change of the readings due to an entry in σ, ``(time, sensor)``.

        Raises:
            InputError: the simulation blows up.
        """
        states = run_truth(
            true_system(self.system, self.twin(entry)), self.start, self.times[: self.recorded]
        )
        return (self._operator(states) - self._clean) / self._sigma

    @cached_property
    def _operator(self) -> ObservationOperator:
        return ObservationOperator(self.sensors, self.system)

    @cached_property
    def _clean(self) -> Tensor:
        """Noise-free readings of the unchanged simulator, ``(time, sensor)``."""
        return self._operator(self.plain)

    @cached_property
    def _sigma(self) -> Tensor:
        reads = [self.system.evaluate(sensor.reads, self.plain) for sensor in self.sensors]
        return self.case.noise * torch.stack([quantity.std() for quantity in reads])

    def _scale(self, equation: str, term: str) -> float:
        """Return the coefficient that gives a term the rms of its equation's tendency."""
        own = Term(equation, self.system.equations[equation])
        added = Term(equation, self.system.parse(term, str(self.case), equation=equation))
        columns = torch.stack(
            [
                evaluate_terms(self.system, [own, added], states[None], t)
                for t, states in zip(self.times.tolist(), self.plain, strict=False)
            ]
        )
        own_rms, added_rms = columns.transpose(0, 1).flatten(1).square().mean(dim=1).sqrt()
        return float(own_rms / added_rms.clamp(min=1e-12))

    def _fault(self, fault: dict[str, Any]) -> dict[str, Any]:
        """Assign a fault to a fitted sensor and give it its size."""
        names = self._fitted
        name = names[int(fault["sensor"] * len(names))]
        index = [sensor.name for sensor in self.sensors].index(name)
        kind, sign = fault["kind"], fault["value"]
        if self.case.kind == "null":
            return {"sensor": name, "kind": kind, "value": float(f"{sign:.4g}")}
        value = self._size_of_fault(kind, sign, index)
        return {"sensor": name, "kind": kind, "value": float(f"{value:.4g}")}

    def _size_of_fault(self, kind: str, sign: float, index: int) -> float:
        assert self.case.effect is not None
        sigma, duration = float(self._sigma[index]), self.config.recording.duration
        effect = self.case.effect * sigma
        if kind == "stuck":
            return duration * float(self.case.stream("stuck").uniform(0.2, 0.55))
        if kind == "drift":
            return sign * 2 * effect / duration
        if kind == "spikes":
            return sign * (SPIKE_OFFSET * sigma + effect)
        if kind == "misplaced":
            _, length = SYSTEMS[self.case.system].axis
            return sign * min(
                MAX_DISPLACEMENT * length,
                max(MIN_DISPLACEMENT * length, effect / self._slope(index)),
            )
        return sign * effect

    def _slope(self, index: int) -> float:
        """Return the rms of the spatial derivative at a sensor."""
        sensor, step = self.sensors[index], 1e-3 * self.system.axes[0].length
        first, *rest = sensor.position
        beside = type(sensor)(sensor.name, sensor.reads, (first + step, *rest), None)
        here, there = ObservationOperator([sensor, beside], self.system)(self.plain).unbind(-1)
        return float(((there - here) / step).square().mean().sqrt())

    @cached_property
    def _fitted(self) -> list[str]:
        """Names of the sensors that the analysis fits; other faults could not be found."""
        times = self.times[: self.recorded].numpy()
        recording = Recording(tuple(self.sensors), times, self._clean.numpy())
        split = split_recording(recording, self.config.splits, self.case.analysis_seed)
        return list(split.fit.names)


def _search(effect: Callable[[float], float | None], wanted: float) -> tuple[float, float]:
    """Return a size whose effect is close to the wanted one, and its effect.

    Raises:
        InputError: no size that was tried could be simulated.
    """
    size, best = INITIAL_SIZE, None
    for _ in range(ROUNDS):
        found = effect(size)
        if found is None or found == 0:
            size *= 0.3
            continue
        if best is None or abs(found - wanted) < abs(best[1] - wanted):
            best = size, found
        if abs(found / wanted - 1) < TOLERANCE or (size == MAX_SIZE and found < wanted):
            break
        size = min(MAX_SIZE, size * min(5.0, max(0.2, wanted / found)))
    if best is None:
        raise InputError("the hidden effect makes the simulation blow up")
    return best
