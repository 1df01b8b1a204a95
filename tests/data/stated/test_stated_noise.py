"""The noise of sensors in units or as a share of their readings' std."""

from __future__ import annotations

import numpy as np
import pytest

from dashred.core.errors import InputError
from dashred.core.stated.noise import parse_noise
from dashred.data.episodes import Episode, Episodes
from dashred.data.recording import Recording
from dashred.data.sensors import Sensor
from dashred.data.stated.stated_noise import resolve_shares, with_noise_of_sensors

TIMES = np.arange(100.0)


def recorded(*sensors: Sensor, level: float = 1.0) -> Recording:
    """Return readings that alternate between 1 and 3, and are far away in the last fifth."""
    values = 2 + level * np.where(TIMES % 2, 1.0, -1.0)
    values[80:] = 1e6
    return Recording(sensors, TIMES, np.column_stack([values] * len(sensors)))


def stds(episodes: Episodes) -> list[float | None]:
    return [sensor.std for sensor in episodes.sensors]


@pytest.mark.parametrize(
    ("given", "found"),
    [(0.1, (0.1, None)), ("0.1", (0.1, None)), ("5%", (None, 0.05)), (" 5 % ", (None, 0.05))],
)
def test_a_noise_is_a_number_or_a_share(given, found):
    std, share, law = parse_noise(given, "std", "here")
    assert law is None
    assert std == pytest.approx(found[0])
    assert share == pytest.approx(found[1])


@pytest.mark.parametrize("given", [0, -1, "x", "-5%", "%", "inf", "nan", True, [1], "1_0", None])
def test_anything_else_is_refused(given):
    with pytest.raises(InputError, match=r"std is .* but must be a positive number"):
        parse_noise(given, "std", "here")


def test_shares_are_of_the_readings_before_the_held_out_end():
    sensors = Sensor("a", "u", (), None, 0.1), Sensor("b", "u", (), 0.3)
    parts = Episode("1", recorded(*sensors)), Episode("2", recorded(*sensors, level=7.0))
    found = resolve_shares(Episodes(parts), 2, 0.2)
    # The rms over episodes of the std: sqrt((1 + 49) / 2) = 5.
    assert stds(found) == [pytest.approx(0.5), 0.3]
    assert all(sensor.std_share is None for sensor in found.sensors)


def test_an_episode_that_is_held_out_as_a_whole_is_not_read():
    sensor = Sensor("a", "u", (), None, 0.1)
    still = Recording((sensor,), TIMES, np.ones((100, 1)))
    parts = (Episode("1", recorded(sensor)), Episode("2", still), Episode("3", recorded(sensor)))
    held_out = Episode("4", recorded(sensor, level=1e3))
    assert stds(resolve_shares(Episodes((*parts, held_out)), 3, 0.2)) == [pytest.approx(0.1)]


def test_the_configuration_overrides_by_sensor_and_by_quantity():
    sensors = Sensor("a", "u"), Sensor("b", "u", (), 0.3), Sensor("c", "v", (), 0.3)
    episodes = Episodes((Episode("", recorded(*sensors)),))
    assert with_noise_of_sensors(episodes, None, "here") is episodes
    assert stds(with_noise_of_sensors(episodes, 0.2, "here")) == [0.2, 0.2, 0.2]
    named = with_noise_of_sensors(episodes, {"u": 0.2, "a": "10%"}, "here")
    assert stds(named) == [None, 0.2, 0.3] and named.sensors[0].std_share == 0.1
    with pytest.raises(InputError, match="names 'w', but no sensor") as refused:
        with_noise_of_sensors(episodes, {"w": 0.2}, "conf.yaml:3")
    assert "conf.yaml:3" in str(refused.value)


def test_a_share_of_a_constant_sensor_is_unknown():
    still = Recording((Sensor("a", "u", (), None, 0.1),), TIMES, np.ones((100, 1)))
    assert stds(resolve_shares(Episodes((Episode("", still),)), 1, 0.2)) == [None]
