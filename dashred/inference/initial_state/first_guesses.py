"""First guesses of the start: the state at a recording's first sample, from several sources.

A fit begins from each and the validation sensors choose
(docs/method.md#first-guesses). ``prior`` is right
where the recording begins as the simulator would; where a front stands at a phase that nobody
knows, only the others are: ``blue``, ``filter`` and ``dashred``.
"""

from __future__ import annotations

from collections.abc import Sequence
from contextlib import suppress
from dataclasses import dataclass, field

from jaxtyping import Float
from torch import Tensor

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
from dashred.physics.system import System, Term


@dataclass(frozen=True)
class FirstGuessSettings:
    """How first guesses are made; defaults from trials on the rotating detonation engine.

    Attributes:
        analogs: simulated states that the estimates are made of.
        window: samples that choose the analogs and make the linear estimate.
        filtered: samples that the filter assimilates.
        modes: of each first guess, at most.
        inflation: of the modes. The first samples, which made the estimate, are fitted once more:
            an estimate that is believed too much would leave its errors to the law.
        filter: localisation and inflation of the filter.
    """

    analogs: int = 192
    window: int = 5
    filtered: int = 15
    modes: int = 60
    inflation: float = 2.0
    filter: FilterSettings = field(default_factory=FilterSettings)


@dataclass(frozen=True)
class Readings:
    """The fitted part of a recording.

    Attributes:
        times: ``(time,)``.
        values: ``(time, sensor)``; NaN is missing.
        operator: H of its sensors.
        noise: σ of each sensor, ``(sensor,)``.
    """

    times: Tensor
    values: Tensor
    operator: ObservationOperator
    noise: Tensor


@dataclass(frozen=True)
class NetworkEstimate:
    """DA-SHRED's field at the first sample.

    Attributes:
        state: ``(field, *grid)``.
        error: its RMSE by field, in the fields' units, ``(field,)``; on simulations that it was
            not trained on, for want of better.
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
) -> dict[str, StartModel]:
    """Return the first guesses by name: ``prior``, ``blue``, ``filter`` and ``dashred``.

    ``dashred`` is left out if it is not known, and a filter whose members blow up under their
    random laws.

    Args:
        system: the simulator, with the step that is good enough for an ensemble.
        prior: of the simulator's start.
        ensemble: randomised simulations on the recording's clock.
        terms: the library that the ensemble's coefficients belong to.
        readings: of the fit sensors.
        network: DA-SHRED's estimate.
        settings: how.
    """
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
    scale = field_rms(ensemble.states.flatten(0, 1))
    guesses: dict[str, StartModel] = {
        "prior": prior,
        "blue": linear_guess(analogs, begin, scale, settings),
    }
    with suppress(FilterLostError):
        guesses["filter"] = filter_guess(system, analogs, terms, readings, scale, settings)
    if network is not None:
        guesses["dashred"] = network_guess(network, analogs, settings)
    return guesses


def linear_guess(
    analogs: Analogs,
    begin: Readings,
    scale: Float[Tensor, " field"],
    settings: FirstGuessSettings,
) -> LinearStart:
    """Return the linear estimate among the analogs from the window that chose them."""
    estimate = linear_estimate(analogs.states, analogs.readings, begin.values, begin.noise)
    return leading_modes(estimate, scale, settings.modes, settings.inflation)


def filter_guess(
    system: System,
    analogs: Analogs,
    terms: Sequence[Term],
    readings: Readings,
    scale: Float[Tensor, " field"],
    settings: FirstGuessSettings,
) -> LinearStart:
    """Return the start as the filter, begun from the analogs, smooths it.

    The window is used twice, to choose the analogs and in the filter: the choice is among many
    more states than there are analogs, and its tolerance is far wider than the noise.

    Raises:
        FilterLostError: its members blow up.
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
    )
    estimate = Estimate(found.start_mean, found.start_anomalies)
    return leading_modes(estimate, scale, settings.modes, settings.inflation)


def network_guess(
    network: NetworkEstimate, analogs: Analogs, settings: FirstGuessSettings
) -> LinearStart:
    """Return DA-SHRED's state with the analogs' modes, each field's as large as its error."""
    anomalies = analogs.states - analogs.states.mean(dim=0)
    spread = field_rms(anomalies)
    modes = leading_modes(Estimate(network.state, anomalies), spread, settings.modes, 1.0).modes
    left = modes.square().sum(dim=0).reshape(len(network.state), -1).mean(dim=1).sqrt()
    factor = (network.error / left).reshape(-1, *(1,) * (network.state.dim() - 1))
    return LinearStart(network.state, factor * modes)
