"""Independent fits, such as those of several hypotheses.

If there is a cluster and the fits are large, its workers compute them side by side. The bits of a
fit do not depend on where it is computed.
"""

from __future__ import annotations

import time
from collections import Counter
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from itertools import takewhile
from typing import Generic, NamedTuple, TypeVar

import torch
from torch import Tensor

from dashred.core.budget import Deadline, OutOfTimeError, in_time
from dashred.core.cluster.calls import ClusterCalls, cluster_in_use
from dashred.core.threads import in_threads
from dashred.core.work import add_work, counted
from dashred.inference.fit.least_squares import LeastSquaresProblem
from dashred.inference.fit.noise_model import NoiseModel
from dashred.inference.forward.forcing_block import ForcingBlock
from dashred.inference.forward.forward_model import ForwardModel
from dashred.inference.forward.law_block import LawBlock
from dashred.inference.forward.sensor_block import SensorBlock
from dashred.inference.forward.simulator import Simulator
from dashred.inference.initial_state.start_models import StartModel

T = TypeVar("T")


@dataclass(frozen=True)
class Fit(Generic[T]):
    """A fit that depends on no other.

    Attributes:
        problem: F.
        run: fits it; a function of a module with some of its arguments, which can be sent.
    """

    problem: LeastSquaresProblem
    run: Callable[[LeastSquaresProblem], T]

    def __call__(self) -> T:
        """Return the result."""
        return self.run(self.problem)


def fit_in_time(fits: Sequence[Fit[T]]) -> list[T]:
    """Return the results in order, as far as the time allows."""
    calls = cluster_in_use()
    if calls is None or len(fits) < 2 or not fits[0].problem.forward_model.has_large_jacobian:
        return in_time(Fit.__call__, fits)
    return _on_workers(calls, fits)


def fit_all(fits: Sequence[Fit[T]]) -> list[T]:
    """Return the results in order.

    Raises:
        OutOfTimeError: the time does not suffice for all.
    """
    found = fit_in_time(fits)
    if len(found) < len(fits):
        raise OutOfTimeError
    return found


class _Rest(NamedTuple):
    """What is sent of F with every fit; a worker keeps simulator, start and sensors."""

    law: LawBlock
    times: Tensor
    forcing: ForcingBlock | None
    recorded: Tensor
    noise: NoiseModel
    prior_std: Tensor


def _on_workers(calls: ClusterCalls, fits: Sequence[Fit[T]]) -> list[T]:
    found: dict[int, tuple[T, Counter[str]]] = {}

    def run(i: int) -> None:
        problem, model = fits[i].problem, fits[i].problem.forward_model
        kept = model.simulator, model.start, model.sensors
        own = model.law, model.times, model.forcing
        rest = _Rest(*own, problem.recorded, problem.noise, problem.prior_std)
        seconds = problem.deadline.at - time.monotonic()
        try:
            found[i] = calls.call_with(kept, fit_on_worker, rest, fits[i].run, seconds)
        except OutOfTimeError:
            return

    for _ in in_threads(run, len(fits), calls.count):
        pass
    for _, work in found.values():
        add_work(work)
    return [found[i][0] for i in takewhile(found.__contains__, range(len(fits)))]


def fit_on_worker(
    simulator: Simulator,
    start: StartModel,
    sensors: SensorBlock,
    rest: _Rest,
    run: Callable[[LeastSquaresProblem], T],
    seconds: float,
) -> tuple[T, Counter[str]]:
    """Return the result of a fit, and the work that it was.

    Args:
        simulator: part of the forward model, as are start and sensors.
        start: u₀(z).
        sensors: H.
        rest: what else makes up F.
        run: fits it.
        seconds: time after which the fit ends.
    """
    model = ForwardModel(simulator, start, rest.law, sensors, rest.times, rest.forcing)
    deadline = Deadline(time.monotonic() + seconds)
    problem = LeastSquaresProblem(model, rest.recorded, rest.noise, rest.prior_std, deadline)
    with counted() as work, torch.no_grad():
        return run(problem), work
