"""One case's start, sensors and clock, on which the size of what is hidden is tried."""

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
    clock_of,
    draw_start,
    run_truth,
    simulators_points,
    with_law,
)
from dashred.evaluation.twins.twin_file import Twin, twin_of
from dashred.physics.library import evaluate_terms
from dashred.physics.solvers.simulate import simulate
from dashred.physics.system import System, Term

# Shares of an equation's tendency, or of a parameter's value: where the search begins, and the most
# that may be hidden.
FIRST, MOST = 0.03, 0.5
ROUNDS, CLOSE = 6, 0.2
# The real trajectory may differ from the simulator's by at most this share of a trace's std.
FARTHEST = 0.7
# At which the effect of a law, or of a parameter, is about linear.
SMALL = 0.01
# A misplaced sensor is off by such shares of the axis.
NEAR, FAR = 0.0025, 0.03
# A spike exceeds what noise does now and then.
SPIKE = 6.0


@dataclass(frozen=True)
class Sizes:
    """One case's start, sensors and clock, on which sizes are tried."""

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
        """Draw start and places; run the simulator as it is."""
        times = clock_of(config)
        recorded = int((times <= config.recording.duration * (1 + 1e-9)).sum())
        spread = {"terms": [], "spread": case.hidden.get("spread", 1.0)}
        only_start = twin_of(str(case), spread, str(case), config)
        start = draw_start(system, system, only_start, config, case.stream("start"))
        sensors = place_sensors(system, config, case.stream("read"))
        plain = run_truth(system, start, times[:recorded])
        return cls(case, system, config, start, times, recorded, sensors, plain)

    def twin(self, entry: dict[str, Any]) -> Twin:
        """Return the twin that an entry describes."""
        return twin_of(str(self.case), entry, str(self.case), self.config)

    def fitting_size(self, case: Case) -> tuple[float, float | None]:
        """Return the size of what is hidden, and its effect.

        Raises:
            InputError: nothing that was tried could be simulated.
        """
        if case.share is not None:
            return case.share, self.effect(case.hidden, case.share)
        assert case.effect is not None
        wanted = min(case.effect, FARTHEST / case.noise)
        return _search(lambda size: self.effect(case.hidden, size), wanted)

    def effect(self, hidden: dict[str, Any], size: float) -> float | None:
        """Return by how many σ a hidden law moves the readings, rms; None if it blows up."""
        try:
            return float(self._moved(self.sized(hidden, size)).square().mean().sqrt())
        except InputError:
            return None

    def numerical_error(self, lawful: System, truth: Tensor) -> float:
        """Return χ² of the simulator's own run, law and start as they are, against the truth.

        Args:
            lawful: the system as it really is, at the simulator's resolution.
            truth: at doubled resolution, ``(time, field, *grid)``.
        """
        own = simulate(lawful, simulators_points(self.start), self.times[: self.recorded])[0]
        wrong = (self._operator(own) - self._operator(truth)) / self._sigma
        return float(wrong.square().sum().nan_to_num(torch.inf))

    def sized(self, hidden: dict[str, Any], size: float) -> dict[str, Any]:
        """Return the entry in the user's units: a law of some size, faults by their effect."""
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
        """Return the share of a parameter, per size of the law, that hides the law best.

        ``−r·p/p·p``, least squares over the readings, of what either does to them alone.
        """
        law = {"terms": self.case.hidden["terms"]}
        parameter = {"terms": [], "parameters": {self.case.hidden["masked_by"]: 1.0}}
        r, p = (self._moved(self.sized(entry, SMALL)) for entry in (law, parameter))
        return -float((r * p).sum() / p.square().sum())

    def _moved(self, entry: dict[str, Any]) -> Tensor:
        """Return by what an entry moves the readings, ``(time, sensor)``.

        Raises:
            InputError: it blows up.
        """
        states = run_truth(
            with_law(self.system, self.twin(entry)), self.start, self.times[: self.recorded]
        )
        return (self._operator(states) - self._clean) / self._sigma

    @cached_property
    def _operator(self) -> ObservationOperator:
        return ObservationOperator(self.sensors, self.system)

    @cached_property
    def _clean(self) -> Tensor:
        """What the sensors read of the simulator as it is, ``(time, sensor)``."""
        return self._operator(self.plain)

    @cached_property
    def _sigma(self) -> Tensor:
        reads = [self.system.evaluate(sensor.reads, self.plain) for sensor in self.sensors]
        return self.case.noise * torch.stack([whole.std() for whole in reads])

    def _scale(self, equation: str, term: str) -> float:
        """Return the coefficient that gives a term the rms of its equation's tendency."""
        own = Term(equation, self.system.equations[equation])
        mine = Term(equation, self.system.parse(term, str(self.case), equation=equation))
        columns = torch.stack(
            [
                evaluate_terms(self.system, [own, mine], states[None], t)
                for t, states in zip(self.times.tolist(), self.plain, strict=False)
            ]
        )
        whole, part = columns.transpose(0, 1).flatten(1).square().mean(dim=1).sqrt()
        return float(whole / part.clamp(min=1e-12))

    def _fault(self, fault: dict[str, Any]) -> dict[str, Any]:
        """Give a fault its sensor, one that the analysis fits, and its size."""
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
            return sign * (SPIKE * sigma + effect)
        if kind == "misplaced":
            _, length = SYSTEMS[self.case.system].axis
            return sign * min(FAR * length, max(NEAR * length, effect / self._slope(index)))
        return sign * effect

    def _slope(self, index: int) -> float:
        """Return the rms of the field's slope at a sensor."""
        sensor, step = self.sensors[index], 1e-3 * self.system.axes[0].length
        first, *rest = sensor.position
        beside = type(sensor)(sensor.name, sensor.reads, (first + step, *rest), None)
        here, there = ObservationOperator([sensor, beside], self.system)(self.plain).unbind(-1)
        return float(((there - here) / step).square().mean().sqrt())

    @cached_property
    def _fitted(self) -> list[str]:
        """The sensors that the analysis will fit: a fault of another cannot be found."""
        times = self.times[: self.recorded].numpy()
        recording = Recording(tuple(self.sensors), times, self._clean.numpy())
        split = split_recording(recording, self.config.splits, self.case.analysis_seed)
        return list(split.fit.names)


def _search(effect: Callable[[float], float | None], wanted: float) -> tuple[float, float]:
    """Return a size, and its effect, near the one that is wanted.

    Raises:
        InputError: nothing that was tried could be simulated.
    """
    size, best = FIRST, None
    for _ in range(ROUNDS):
        found = effect(size)
        if found is None or found == 0:
            size *= 0.3
            continue
        if best is None or abs(found - wanted) < abs(best[1] - wanted):
            best = size, found
        if abs(found / wanted - 1) < CLOSE or (size == MOST and found < wanted):
            break
        size = min(MOST, size * min(5.0, max(0.2, wanted / found)))
    if best is None:
        raise InputError("what was to be hidden blows the simulator up")
    return best
