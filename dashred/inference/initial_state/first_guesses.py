"""First guesses of the start, the state at the first sample of a recording, from several sources.

A fit starts from each of them, and the validation sensors rank the fits
(docs/method.md#first-guesses). ``prior`` is suitable if the recording begins as the simulator does.
If a front has an unknown phase, only ``blue``, ``filter`` and ``dashred`` are suitable.
"""

from __future__ import annotations

from collections.abc import Sequence
from contextlib import suppress
from dataclasses import dataclass, field

import torch
from jaxtyping import Float
from torch import Tensor

from dashred.core.budget import NEVER, Deadline, OutOfTimeError
from dashred.data.observation_operator import ObservationOperator
from dashred.inference.initial_state.analogs import Analogs, nearest_analogs
from dashred.inference.initial_state.ensemble_filter import (
    FilterLostError,
    FilterSettings,
    ensemble_filter,
)
from dashred.inference.initial_state.linear_estimate import Estimate, leading_modes, linear_estimate
from dashred.inference.initial_state.start_models import LinearStart, StartModel
from dashred.physics.runs.ensemble import Ensemble
from dashred.physics.runs.initial_state_prior import StartPrior, field_rms
from dashred.physics.runs.stored_states import rms_of_fields
from dashred.physics.system import System, Term


@dataclass(frozen=True)
class FirstGuessSettings:
    """Settings of the first guesses; the defaults are from trials on ``rde``.

    Attributes:
        analogs: number of analogs.
        window: number of samples that select the analogs and give the linear estimate.
        filtered: number of samples that the filter assimilates.
        modes: largest number of modes of a first guess.
        inflation: factor on the modes. The fit uses the first samples a second time. An
            overconfident estimate would force its errors into the law.
        filter: settings of the filter.
    """

    analogs: int = 192
    window: int = 5
    filtered: int = 15
    modes: int = 60
    inflation: float = 2.0
    filter: FilterSettings = field(default_factory=FilterSettings)


@dataclass(frozen=True)
class Readings:
    """The readings of the fitted part of a recording.

    Attributes:
        times: ``(time,)``.
        values: ``(time, sensor)``; NaN where missing.
        operator: H of the sensors.
        noise: σ of each sensor, ``(sensor,)``.
    """

    times: Tensor
    values: Tensor
    operator: ObservationOperator
    noise: Tensor


@dataclass(frozen=True)
class NetworkEstimate:
    """The field that DA-SHRED reconstructs at the first sample.

    Attributes:
        state: ``(field, *grid)``.
        error: RMSE of each field, in the unit of the field, ``(field,)``, on simulations that were
            not used for training.
    """

    state: Tensor
    error: Tensor


def first_guesses(
    system: System,
    prior: StartPrior,
    ensemble: Ensemble,
    terms: Sequence[Term],
    readings: Readings,
    network: NetworkEstimate | None,
    settings: FirstGuessSettings,
    deadline: Deadline = NEVER,
) -> dict[str, StartModel]:
    """Return the first guesses by name: ``prior``, ``blue``, ``filter`` and ``dashred``.

    ``dashred`` is left out without an estimate of the network, and ``filter`` if it diverges. Those
    that are not ready at the deadline are left out.

    Args:
        system: the simulator, with the time step of the ensemble.
        prior: prior of the simulator's start.
        ensemble: randomised simulations at the times of the recording.
        terms: the library; the coefficients of the ensemble belong to it.
        readings: readings of the fit sensors.
        network: estimate of DA-SHRED; None if there is none.
        settings: settings of the first guesses.
        deadline: time at which the computation ends.
    """
    guesses: dict[str, StartModel] = {"prior": prior}
    if deadline.is_over:
        return guesses
    begin = Readings(
        readings.times[: settings.window],
        readings.values[: settings.window],
        readings.operator,
        readings.noise,
    )
    analogs = nearest_analogs(
        system,
        ensemble,
        terms,
        begin.operator.sensors,
        begin.values,
        begin.noise,
        settings.analogs,
    )
    scale = rms_of_fields(ensemble.states)
    guesses["blue"] = linear_guess(analogs, begin, scale, settings)
    with suppress(FilterLostError, OutOfTimeError):
        guesses["filter"] = filter_guess(
            system, analogs, terms, readings, scale, settings, deadline
        )
    if network is not None and not deadline.is_over:
        guesses["dashred"] = network_guess(network, analogs, settings)
    return guesses


def linear_guess(
    analogs: Analogs,
    begin: Readings,
    scale: Float[Tensor, " field"],
    settings: FirstGuessSettings,
) -> LinearStart:
    """Return the linear estimate from the analogs and the window that selected them."""
    estimate = linear_estimate(analogs.states, analogs.readings, begin.values, begin.noise)
    return leading_modes(estimate, scale, settings.modes, settings.inflation)


def filter_guess(
    system: System,
    analogs: Analogs,
    terms: Sequence[Term],
    readings: Readings,
    scale: Float[Tensor, " field"],
    settings: FirstGuessSettings,
    deadline: Deadline,
) -> LinearStart:
    """Return the smoothed start of the filter, whose initial members are the analogs.

    The window is used twice, to select the analogs and in the filter. This is acceptable: the
    analogs are few of many states, and their misfit is far larger than the noise.

    Raises:
        FilterLostError: more than half of the members blow up.
        OutOfTimeError: the deadline is over.
    """
    samples = slice(min(settings.filtered, len(readings.times)))
    found = ensemble_filter(
        system,
        analogs.states,
        analogs.coefficients,
        terms,
        readings.times[samples],
        readings.values[samples],
        readings.operator,
        readings.noise,
        settings.filter,
        deadline,
    )
    estimate = Estimate(found.start_mean, found.start_anomalies)
    return leading_modes(estimate, scale, settings.modes, settings.inflation)


def network_guess(
    network: NetworkEstimate, analogs: Analogs, settings: FirstGuessSettings
) -> LinearStart:
    """Return the state of DA-SHRED with modes of the analogs, scaled to the error of each field."""
    anomalies = analogs.states - analogs.states.mean(dim=0)
    spread = field_rms(anomalies)
    modes = leading_modes(Estimate(network.state, anomalies), spread, settings.modes, 1.0).modes
    left = modes.square().sum(dim=0).reshape(len(network.state), -1).mean(dim=1).sqrt()
    known = torch.where(left > 0, network.error / left, 0.0)
    factor = known.reshape(-1, *(1,) * (network.state.dim() - 1))
    return LinearStart(network.state, factor * modes)
