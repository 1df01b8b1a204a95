"""Search for faults of one or several sensors on a linearised problem.

A faulty sensor pulls the fit towards its own readings. All unknowns of the fit are therefore
adjusted again for every fault that is tried (docs/method.md#sensor-faults).
"""

from __future__ import annotations

from collections.abc import Collection, Iterator, Sequence
from dataclasses import dataclass, field, replace

import torch
from torch import Tensor

from dashred.inference.fit.least_squares import LeastSquaresProblem, NormalEquations
from dashred.inference.forward.sensor_block import SensorErrors
from dashred.inference.sensor_faults.fault import Alternatives, Fault, count_sensors
from dashred.inference.sensor_faults.fault_table import fault_candidates
from dashred.inference.sensor_faults.linearised_fit import Columns, LinearisedFit


@dataclass(frozen=True)
class FaultSet:
    """Faults of different sensors, as predicted by the linearised problem.

    Attributes:
        faults: at most one of each sensor.
        cost: F at the minimum over all unknowns, with the constants of the faults.
        penalty: penalty for the degrees of freedom of all faults.
        parameters: parameters of each fault, ``(parameter,)``; empty if it only removes samples.
        covariances: their posterior covariances.
    """

    faults: tuple[Fault, ...]
    cost: float
    penalty: float
    parameters: tuple[Tensor, ...]
    covariances: tuple[Tensor, ...]

    @property
    def score(self) -> float:
        """``F + penalty``."""
        return self.cost + self.penalty

    @property
    def constant(self) -> float:
        """Sum of the constants of the faults."""
        return sum(fault.constant for fault in self.faults)

    @property
    def key(self) -> frozenset[tuple[str, int]]:
        """Kinds and sensors."""
        return frozenset((fault.kind, fault.sensor) for fault in self.faults)


@dataclass(frozen=True)
class FaultProblem:
    """A linearised problem with some faults, to which others may be added.

    Attributes:
        objective: F without the samples that the faults remove.
        linear: F linearised about a fit, with the columns of the faults.
        states: states of that fit, ``(time, episode, field, *grid)``.
        faults: what was added.
        columns: of the faults that were tried, by kind and sensor; they are the same beside other
            faults.
    """

    objective: LeastSquaresProblem
    linear: LinearisedFit
    states: Tensor
    faults: FaultSet
    columns: dict[tuple[str, int], Columns] = field(default_factory=dict)

    @classmethod
    def at(
        cls, objective: LeastSquaresProblem, phi: Tensor, normal: NormalEquations
    ) -> FaultProblem:
        """Return the problem without faults about a fit.

        Args:
            objective: F of a law.
            phi: its fit, ``(unknown,)``.
            normal: F linearised about this fit.
        """
        [states] = objective.forward_model.states(*objective.split(phi[None]))
        linear = LinearisedFit.of(normal)
        return cls(objective, linear, states, FaultSet((), linear.cost, 0.0, (), ()))

    def add(self, alternatives: Alternatives) -> FaultProblem:
        """Return the problem with the best of some alternatives, and its parameters.

        The parameters of the earlier faults are those of the earlier minimum.
        """
        if alternatives[0].errors is None:
            return self._remove_samples(alternatives[0])
        columns = self._columns(alternatives[0], alternatives[0].errors)
        profile, before = self.linear.profile(columns), self.faults
        constant = sum(each.constant for each in before.faults)
        tried = []
        for fault in alternatives:
            assert fault.errors is not None
            estimate = profile.minimum(fault.errors.scales)
            faults = FaultSet(
                (*before.faults, fault),
                estimate.cost + constant,
                before.penalty + self._penalty(fault, profile.information),
                (*before.parameters, estimate.parameters),
                (*before.covariances, estimate.covariance),
            )
            tried.append((faults, fault.errors.scales))
        faults, scales = min(tried, key=lambda pair: pair[0].score)
        linear = self.linear.with_columns(columns, scales)
        return replace(self, linear=linear, faults=faults)

    def _columns(self, fault: Fault, errors: SensorErrors) -> Columns:
        """Return the columns of a fault, which are linearised once."""
        key = fault.kind, fault.sensor
        if key not in self.columns:
            self.columns[key] = _linearise_errors(self.objective, errors, self.states)
        return self.columns[key]

    def _remove_samples(self, fault: Fault) -> FaultProblem:
        """Return the problem with a fault that has no parameters."""
        objective, before = without_samples(self.objective, fault), self.faults
        removed = objective.noise.available != self.objective.noise.available
        cost = self.linear.cost_without(removed.flatten())
        linear = self.linear.without_rows(removed.flatten())
        none = torch.zeros(0, dtype=torch.float64)
        constant = sum(each.constant for each in (*before.faults, fault))
        faults = FaultSet(
            (*before.faults, fault),
            cost + constant,
            before.penalty + self._penalty(fault, none),
            (*before.parameters, none),
            (*before.covariances, none),
        )
        # The columns of other faults do not have the removed samples either.
        return replace(self, objective=objective, linear=linear, faults=faults, columns={})

    def _penalty(self, fault: Fault, information: Tensor) -> float:
        samples, sensors = self.objective.noise.effective_count, self.objective.recorded.shape[1]
        return fault.penalty(information, samples, sensors)

    def add_each(self, sensors: Collection[int], kinds: Collection[str]) -> list[FaultProblem]:
        """Return the problem with each fault of each sound sensor, the best of each kind.

        Args:
            sensors: columns of the sensors that may be faulty.
            kinds: the kinds of faults that are tried.
        """
        return sorted(map(self.add, self._candidates(sensors, kinds)), key=_by_score)

    def _candidates(
        self, sensors: Collection[int], kinds: Collection[str]
    ) -> Iterator[Alternatives]:
        block = self.objective.forward_model.sensors
        faulty = {block.sensors[fault.sensor].name for fault in self.faults.faults}
        for sensor in sensors:
            is_seen = bool(self.objective.noise.available[:, sensor].any())
            if is_seen and block.sensors[sensor].name not in faulty:
                yield from fault_candidates(self.objective, self.linear, sensor, kinds)


def find_faults(
    problem: FaultProblem,
    sensors: Collection[int],
    kinds: Collection[str],
    count: int,
    margin: float = 0.0,
) -> FaultSet:
    """Return the faults that lower the score, one sensor after the other.

    The kind of every fault is then chosen again beside all others.

    Args:
        problem: a problem without faults.
        sensors: columns of the sensors that may be faulty.
        kinds: the kinds of faults that are tried.
        count: largest number of faults.
        margin: a fault must lower the score by more than this.
    """
    found = problem
    for _ in range(count):
        tried = found.add_each(sensors, kinds)
        if not tried or tried[0].faults.score >= found.faults.score - margin:
            break
        found = tried[0]
    faults = list(found.faults.faults)
    if len(faults) < 2:
        return found.faults
    for index, fault in enumerate(faults):
        others = _add_all(problem, [*faults[:index], *faults[index + 1 :]])
        columns = problem.objective.forward_model.sensors.columns_of(fault.sensor)
        faults[index] = others.add_each(columns, kinds)[0].faults.faults[-1]
    return estimate_faults(problem, faults)


def estimate_faults(problem: FaultProblem, faults: Sequence[Fault]) -> FaultSet:
    """Return faults with the parameters of all of them at their common minimum."""
    whole = _add_all(problem, faults)
    parameters, covariances = [], []
    for index in range(len(faults)):
        own = _add_all(problem, [*faults[:index], *faults[index + 1 :], faults[index]]).faults
        parameters.append(own.parameters[-1])
        covariances.append(own.covariances[-1])
    return replace(whole.faults, parameters=tuple(parameters), covariances=tuple(covariances))


def costs_without_worst(problem: FaultProblem, count: int) -> list[float]:
    """Return F of the linearised problem without its worst sensors, plus 1 for each lost reading.

    No faults of so many sensors leave less, except for faults of sensors that look sound: beside a
    fault, the noise of each reading is left.

    Args:
        problem: a problem without faults.
        count: number of sensors that are left out, one after the other.

    Returns:
        F without the worst 0, 1, … ``count`` sensors.
    """
    linear, recorded = problem.linear, problem.objective.recorded
    block = problem.objective.forward_model.sensors
    removed, seen = torch.zeros(recorded.shape, dtype=torch.bool), problem.objective.noise.available
    costs = [linear.cost]
    misfit = linear.misfit
    for _ in range(count):
        by_column = misfit.reshape(recorded.shape).square().sum(dim=0)
        removed[:, block.columns_of(int(by_column.argmax()))] = True
        costs.append(linear.cost_without(removed.flatten()) + float((removed & seen).sum()))
        misfit = linear.misfit_without(removed.flatten())
    return costs


def without_samples(objective: LeastSquaresProblem, fault: Fault) -> LeastSquaresProblem:
    """Return F without the samples that a fault removes."""
    if fault.samples is None:
        return objective
    seen = objective.noise.available.clone()
    seen[:, fault.sensor] &= ~fault.samples
    return replace(objective, noise=replace(objective.noise, available=seen))


def largest_count(objective: LeastSquaresProblem) -> int:
    """Return how many sensors may be faulty: the sound ones must be more, except for one fault."""
    return max(1, (count_sensors(objective) - 1) // 2)


def _add_all(problem: FaultProblem, faults: Sequence[Fault]) -> FaultProblem:
    for fault in faults:
        problem = problem.add((fault,))
    return problem


def _linearise_errors(
    objective: LeastSquaresProblem, errors: SensorErrors, states: Tensor
) -> Columns:
    """Linearise the effect of a fault on the whitened readings about a first guess."""
    noise, stated = objective.noise, objective.forward_model.sensors.observe(states)
    guess = errors.first_guess(states, objective.recorded, noise.std)
    matrix = noise.whiten(errors.columns(stated, states, guess).movedim(-1, 0)).flatten(1).T
    [shifted] = errors.apply(stated[None], states[None], guess[None])
    effect = noise.whiten(shifted - stated).flatten()
    return Columns.of(matrix, matrix @ guess - effect)


def _by_score(problem: FaultProblem) -> float:
    return problem.faults.score
