"""Which recordings keep their own times."""

from __future__ import annotations

import numpy as np
import pytest

from dashred.data.clocks.own_times import describe_times, has_uneven_times, is_uneven
from dashred.data.episodes import Episode, Episodes
from dashred.data.recording import Recording
from dashred.data.sensors import Sensor

CLOCK = 0.1 * np.arange(200)
RANDOM = np.sort(np.random.default_rng(1).uniform(0, 20, 200))


@pytest.mark.parametrize(
    ("times", "uneven"),
    {
        "a clock": (CLOCK, False),
        "from another time": (1.7e9 + CLOCK, False),
        "a clock that drifts by a thousandth": (CLOCK * (1 + 1e-3), False),
        "with gaps": (np.delete(CLOCK, [5, 6, 7, 90, *range(120, 150)]), False),
        "one sample late": (CLOCK + 0.02 * (np.arange(200) == 77), True),
        "random": (RANDOM, True),
        "in bursts": (np.concatenate([k + 0.01 * np.arange(10) for k in (0, 1.234, 5.3)]), True),
        "spread logarithmically": (np.geomspace(0.1, 100, 60), True),
        "two loggers, one late": (np.sort(np.concatenate([CLOCK, CLOCK + 0.03])), True),
    }.values(),
)
def test_uneven_times_are_recognised(times, uneven):
    assert is_uneven(times) == uneven


def test_one_uneven_episode_is_enough_and_the_times_are_described():
    parts = [
        Episode(
            name,
            Recording(
                (Sensor("u", "u"),), np.asarray(times, np.float64), np.zeros((len(times), 1))
            ),
        )
        for name, times in (("a", CLOCK), ("b", RANDOM))
    ]
    assert not has_uneven_times(Episodes(tuple(parts[:1])))
    assert has_uneven_times(Episodes(tuple(parts)))
    note = describe_times(Episodes(tuple(parts)))
    assert note.startswith("kept the times of 400 samples in 2 episodes, ")
    assert describe_times(Episodes(tuple(parts[:1]))) == (
        "kept the times of 200 samples, 0.1 to 0.1 apart."
    )
