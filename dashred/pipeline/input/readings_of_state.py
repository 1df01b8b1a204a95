"""The recording as readings of the state, with what the configuration states of its sensors."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace
from typing import NamedTuple

from dashred.config import Config
from dashred.data.angles import continue_angles
from dashred.data.episodes import Episodes, fitted_parts, with_sensors
from dashred.data.stated.averages import with_averages
from dashred.data.stated.calibration import with_calibration
from dashred.data.stated.episode_parameters import with_episode_parameters
from dashred.data.stated.fitted_delays import with_fitted_delays
from dashred.data.stated.known_readings import check_uncertain_have_effect, subtract_known_readings
from dashred.data.stated.saturation import has_stops
from dashred.data.stated.stated_noise import resolve_shares, with_noise_of_sensors
from dashred.physics.system import System

# With at least this many episodes, the last one is held out as a whole.
FEWEST_TO_HOLD_OUT = 3


class ReadingsOfState(NamedTuple):
    """A recording whose sensors read functions of the state and of uncertain parameters.

    Attributes:
        system: the simulator, with lets and parameters for what the sensors read.
        episodes: the recording.
        clauses: what was subtracted from it, see :func:`subtract_known_readings`.
        described: the sensor, input or episode of parameters that belong to one.
    """

    system: System
    episodes: Episodes
    clauses: list[str]
    described: Mapping[str, Mapping[str, str]]


def readings_of_state(config: Config, system: System, read: Episodes) -> ReadingsOfState:
    """Return a recording with its stated noise and calibration, of continued angles.

    Args:
        config: states noise, angles and calibration.
        system: the simulator.
        read: the recording as it was read.

    Raises:
        InputError: the noise or the calibration is invalid, an angle turns too fast, a sensor reads
            more than can be subtracted, or nothing depends on an uncertain parameter.
    """
    delayed = with_fitted_delays(system, read)
    by_episode = with_episode_parameters(delayed.system, delayed.episodes)
    system, read = by_episode.system, by_episode.episodes
    check_uncertain_have_effect(system, read.sensors)
    stated, where = config.recording, config.where
    sensors = tuple(replace(s, has_stops=has_stops(system, s.reads)) for s in read.sensors)
    read = with_sensors(read, sensors)
    read = continue_angles(system, read, stated.angles, where("recording.angles"))
    noisy = with_noise_of_sensors(read, stated.std, where("recording.std"))
    system, noisy = with_averages(system, noisy, stated.average, where)
    fitted, held_out = fitted_count(config, read), config.splits.time.test
    noisy = resolve_shares(noisy, fitted, held_out)
    parts = fitted_parts(noisy, fitted, held_out)
    found = with_calibration(system, noisy, parts, stated.calibration, where)
    described: dict[str, dict[str, str]] = {
        **{name: {"sensor": sensor} for name, sensor in found.parameters.items()},
        **{name: {"input": each} for name, each in delayed.parameters.items()},
        **{name: {"episode": episode} for name, episode in by_episode.parameters.items()},
    }
    return ReadingsOfState(*subtract_known_readings(found.system, found.episodes), described)


def fitted_count(config: Config, read: Episodes) -> int:
    """Return the number of episodes that are not held out as a whole.

    An episode with parameters of its own is not: its beginning would have to determine these.
    """
    count = len(read.episodes)
    return count - (count >= FEWEST_TO_HOLD_OUT and not config.system.parameter_per)
