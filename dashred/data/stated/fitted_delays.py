"""Inputs that act after an unknown time, which is fitted.

About a delay d₀ the input e of the equations is, to first order::

    e(t) = u(t - d₀) - (d - d₀) u'(t - d₀)

with the recorded samples u. It becomes a let of two inputs, of which the second is the rate -u',
and of the delay d as an uncertain parameter. A search is repeated about the fitted d.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field, replace

import numpy as np

from dashred.core.errors import InputError
from dashred.data.episodes import Episode, Episodes
from dashred.data.inputs import check_delay, with_inputs
from dashred.data.recording import Recording
from dashred.physics.backends.input_signals import Array, InputSignals
from dashred.physics.declaration import RATE
from dashred.physics.system import System


@dataclass(frozen=True)
class Delayed:
    """A system with fitted delays, and the recording with the rates of its inputs.

    Attributes:
        system: with a parameter for every fitted delay.
        episodes: with a further input for each.
        parameters: name of the input by parameter.
    """

    system: System
    episodes: Episodes
    parameters: Mapping[str, str] = field(default_factory=dict)


def delay_parameter(name: str) -> str:
    """Return the name of the parameter that is the delay of an input."""
    return f"delay_of_{name}"


def with_fitted_delays(system: System, episodes: Episodes) -> Delayed:
    """Return a system whose uncertain delays are uncertain parameters.

    Args:
        system: the simulator.
        episodes: the recording.

    Raises:
        InputError: the system has axes, or a name that a delay needs is taken.
    """
    config, found = system.config, {}
    inputs = dict(config.inputs)
    for name, given in config.inputs.items():
        if not given.delay_spread:
            continue
        place = system.where(f"system.inputs.{name}.delay_spread")
        if system.axes:
            what = f"the delay of {name} cannot be fitted in a system with axes"
            raise InputError(what, where=place, hint="state the delay without a spread")
        for each in episodes.episodes:
            check_delay(name, given.delay, each.recording.inputs, system.where)
        delay, (now, rate) = delay_parameter(name), _inputs_of(name)
        if taken := system.names & {delay, now, rate}:
            what = f"a fitted delay of {name} needs the name {min(taken)}, which is taken"
            raise InputError(what, where=place, hint=f"call {min(taken)} otherwise")
        column = given.column or name
        del inputs[name]
        inputs[now] = replace(given, column=column, delay_spread=0.0)
        # The slopes of straight lines hold; those of jumps are smeared over a step.
        inputs[rate] = replace(inputs[now], column=f"{RATE}{column}", hold=not given.hold)
        found[delay] = name
        config = replace(
            config,
            parameters={**config.parameters, delay: given.delay},
            parameter_spread={**config.parameter_spread, delay: given.delay_spread},
            let={name: _shifted(name, given.delay), **config.let},
        )
        parts = [
            Episode(each.name, _with_rate(each.recording, column, given.hold))
            for each in episodes.episodes
        ]
        episodes = replace(episodes, episodes=tuple(parts))
    if not found:
        return Delayed(system, episodes)
    return Delayed(system.with_config(replace(config, inputs=inputs)), episodes, found)


def about_delays(system: System, delayed: Mapping[str, str], recorded: InputSignals) -> System:
    """Return a system whose inputs act after the delays that its parameters state.

    Args:
        system: with these parameters.
        delayed: name of the input by parameter.
        recorded: samples of the inputs, by column.
    """
    if not delayed:
        return system
    config = system.config
    inputs, lets = dict(config.inputs), dict(config.let)
    for parameter, name in delayed.items():
        delay = max(config.parameters[parameter], 0.0)
        for each in _inputs_of(name):
            inputs[each] = replace(inputs[each], delay=delay)
        lets[name] = _shifted(name, delay)
    changed = replace(config, inputs=inputs, let=lets)
    return with_inputs(System(changed, system.where), recorded)


def _inputs_of(name: str) -> tuple[str, str]:
    """Return the names of the delayed input and of its rate."""
    return f"{name}_now", f"{name}_rate"


def _shifted(name: str, delay: float) -> str:
    now, rate = _inputs_of(name)
    return f"{now} + ({delay_parameter(name)} - {float(delay)!r})*{rate}"


def _with_rate(recording: Recording, column: str, hold: bool) -> Recording:
    """Return a recording with ``-u'`` of an input as a further input."""
    inputs = recording.inputs
    rate = _rate(inputs.times, inputs.values[column], hold)
    values = {**inputs.values, f"{RATE}{column}": rate}
    return replace(recording, inputs=InputSignals(inputs.times, values))


def _rate(times: Array, values: Array, hold: bool) -> Array:
    """Return ``-u'`` at every sample.

    Of straight lines it is that of the following line. Of a jump it is a triangle about the jump,
    with the area of the jump.
    """
    changes, steps = np.diff(values), np.diff(times)
    if not hold:
        return np.append(-changes / steps, 0.0)
    around = (np.append(steps, steps[-1]) + np.append(steps[0], steps)) / 2
    return np.append(0.0, -changes) / around
