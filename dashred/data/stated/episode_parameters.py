"""Parameters with a value of their own in each episode.

With one parameter and one input per episode, ``p = Σ_e p_e 1_e``: the input 1_e is 1 in the episode
e, and 0 in the others. Each p_e has the stated value and spread.
"""

from __future__ import annotations

import re
from collections.abc import Mapping
from dataclasses import dataclass, field, replace

import numpy as np

from dashred.data.episodes import Episode, Episodes
from dashred.data.recording import Recording
from dashred.physics.backends.input_signals import InputSignals
from dashred.physics.declaration import MARK
from dashred.physics.expressions.algebra import Number, substitute, to_text
from dashred.physics.expressions.free_names import take_name
from dashred.physics.system import System
from dashred.physics.system_schema import Input


@dataclass(frozen=True)
class ByEpisode:
    """A system whose parameters differ between episodes, and the recording with its inputs.

    Attributes:
        system: with a parameter per episode.
        episodes: with an input for each.
        parameters: name of the episode by parameter.
    """

    system: System
    episodes: Episodes
    parameters: Mapping[str, str] = field(default_factory=dict)


def with_episode_parameters(system: System, episodes: Episodes) -> ByEpisode:
    """Return a system with one value per episode for the parameters that are stated so.

    Args:
        system: the simulator.
        episodes: the recording. A single episode needs no further parameter.
    """
    stated, config = system.config.parameter_per, system.config
    if not stated or len(episodes.episodes) == 1:
        return ByEpisode(system, episodes)
    taken = set(system.names)
    labels = [re.sub(r"\W", "_", part.name, flags=re.ASCII) for part in episodes.episodes]
    inside = [take_name(f"in_episode_{label}", taken) for label in labels]
    values, spreads = dict(config.parameters), dict(config.parameter_spread)
    lets, found = {}, {}
    for name in stated:
        value, spread = values.pop(name), spreads.pop(name)
        own = [take_name(f"{name}_in_{label}", taken) for label in labels]
        lets[name] = " + ".join(f"{p}*{e}" for p, e in zip(own, inside, strict=True))
        for parameter, part in zip(own, episodes.episodes, strict=True):
            values[parameter], spreads[parameter] = value, spread
            found[parameter] = part.name
            if name in config.units:
                config = replace(config, units={**config.units, parameter: config.units[name]})
    fixed = {name: config.parameters[name] for name in stated}
    config = replace(
        config,
        parameters=values,
        parameter_spread=spreads,
        parameter_per={},
        let=lets | dict(config.let),
        inputs={**config.inputs, **{name: Input(f"{MARK}{name}") for name in inside}},
        # The start and the energy have the stated values.
        start={
            name: _at_stated(system, text, f"system.start.{name}", fixed)
            for name, text in config.start.items()
        },
        energy=config.energy and _at_stated(system, config.energy, "system.energy", fixed),
    )
    parts = tuple(
        Episode(part.name, _with_indicators(part.recording, inside, index))
        for index, part in enumerate(episodes.episodes)
    )
    return ByEpisode(system.with_config(config), replace(episodes, episodes=parts), found)


def _at_stated(system: System, text: object, key: str, values: Mapping[str, float]) -> str:
    numbers = {name: Number(float(value)) for name, value in values.items()}
    return to_text(substitute(system.parse(str(text), key), numbers))


def _with_indicators(recording: Recording, names: list[str], index: int) -> Recording:
    """Return a recording with an input that is 1, and others that are 0."""
    inputs, times = recording.inputs, recording.times
    clock = inputs.times if inputs.values else times[[0, -1]]
    added = {
        f"{MARK}{name}": np.full(len(clock), float(j == index)) for j, name in enumerate(names)
    }
    return replace(recording, inputs=InputSignals(clock, {**inputs.values, **added}))
