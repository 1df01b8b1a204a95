"""Angles are continued across the full turn, whatever their unit and wherever they begin."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from numpy.typing import NDArray

from dashred.core.errors import InputError
from dashred.data.angles import continue_angles
from dashred.data.episodes import Episode, Episodes
from dashred.data.recording import Recording
from dashred.data.sensors import Sensor
from dashred.physics.system import System
from tests import laws

TEXT = """
system:
  title: a rotor
  fields: {theta: angle, omega: rate}
  equations: {theta: omega, omega: -0.1*omega}
  start: {theta: 6.0, omega: 1.0}
  integrator: {method: rk4, dt: 0.1}
recording: {path: rotor.csv}
"""
TIMES = np.linspace(0, 5.9, 60)
TURN = 2 * np.pi


def rotor(folder: Path, text: str = TEXT) -> System:
    return laws.declared(folder, text)


@pytest.fixture(scope="module")
def system(tmp_path_factory: pytest.TempPathFactory) -> System:
    return rotor(tmp_path_factory.mktemp("rotor"))


def episodes(*columns: np.ndarray, units: dict[str, str] | None = None) -> Episodes:
    sensors = (Sensor("encoder", "theta"), Sensor("w", "omega"))
    parts = [
        Episode(
            f"e{i}",
            Recording(
                sensors,
                TIMES[: len(column)],
                np.stack([column, np.ones_like(column)], axis=1),
                units=units or {},
            ),
        )
        for i, column in enumerate(columns)
    ]
    return Episodes(tuple(parts))


def encoder(angle: np.ndarray, turn: float = TURN) -> np.ndarray:
    return (angle + turn / 2) % turn - turn / 2


def continued(
    system: System, found: Episodes, names: tuple[str, ...] = ("theta",)
) -> list[NDArray[np.float64]]:
    done = continue_angles(system, found, names, "here")
    return [part.recording.values[:, 0] for part in done.episodes]


@settings(max_examples=50, deadline=None)
@given(
    rate=st.floats(-10, 10), begin=st.floats(-3, 3), lost=st.sets(st.integers(0, 59), max_size=20)
)
def test_any_rotation_that_the_samples_follow_comes_back(
    system: System, rate: float, begin: float, lost: set[int]
) -> None:
    angle = 6.0 + begin + rate * TIMES * np.cos(0.3 * TIMES)
    read = encoder(angle)
    # Gaps over which the rotor turns by less than half a turn.
    if abs(rate) < 1.5:
        read[[i for i in lost if i % 3]] = np.nan
    [found] = continued(system, episodes(read))
    seen = np.isfinite(read)
    assert np.array_equal(np.isfinite(found), seen)
    np.testing.assert_allclose(found[seen], angle[seen], atol=1e-9)


def test_every_episode_begins_near_the_stated_start(system: System) -> None:
    first, second = 5.9 + 2 * TIMES, 6.3 - TIMES
    found = continued(system, episodes(encoder(first), encoder(second)), ("encoder",))
    np.testing.assert_allclose(found[0], first)
    np.testing.assert_allclose(found[1], second)


def test_degrees(tmp_path: Path) -> None:
    text = TEXT.replace("  start: {theta: 6.0", "  units: {theta: deg}\n  start: {theta: 350")
    angle = 345 + 90 * TIMES
    read = encoder(angle, 360.0)
    [found] = continued(rotor(tmp_path, text), episodes(read, units={"theta": "deg"}))
    np.testing.assert_allclose(found, angle)


def test_after_a_spin_up_the_first_reading_stays(tmp_path: Path) -> None:
    system = rotor(tmp_path, TEXT.replace("  integrator", "  spin_up: 5\n  integrator"))
    [found] = continued(system, episodes(encoder(0.5 + 2 * TIMES)))
    np.testing.assert_allclose(found, 0.5 + 2 * TIMES)


def test_other_sensors_stay(system: System) -> None:
    found = episodes(encoder(6 + 2 * TIMES))
    assert continue_angles(system, found, (), "here") is found
    done = continue_angles(system, found, ("theta",), "here")
    np.testing.assert_array_equal(done.episodes[0].recording.values[:, 1], 1.0)
    assert done.episodes[0].recording.units == {"theta": "rad"}


def test_a_rotor_that_is_too_fast_is_refused(system: System) -> None:
    with pytest.raises(InputError, match="'encoder' moves by nearly half a turn") as caught:
        continued(system, episodes(encoder(29 * TIMES)))
    assert caught.value.hint == "record it more often, or record its rate instead"
    assert "episode 'e0'" in caught.value.what


def test_a_spike_does_not_shift_what_follows(system: System) -> None:
    angle = 5.5 + 0.3 * np.sin(TIMES)
    read = encoder(angle)
    read[30] = encoder(angle[30:31] + 0.49 * TURN)[0]
    [found] = continued(system, episodes(read))
    np.testing.assert_allclose(np.delete(found, 30), np.delete(angle, 30))


def test_readings_of_more_than_a_turn_are_refused(system: System) -> None:
    read = encoder(6 + 2 * TIMES)
    read[7] = -999.0
    with pytest.raises(InputError, match="span 159 turns") as caught:
        continued(system, episodes(read))
    assert "placeholders" in str(caught.value.hint)


def test_an_unknown_name(system: System) -> None:
    with pytest.raises(InputError, match="names 'teta'") as caught:
        continued(system, episodes(encoder(TIMES)), ("teta",))
    assert "theta" in str(caught.value.hint)


def test_a_unit_that_is_no_angle(tmp_path: Path) -> None:
    text = TEXT.replace("  start:", "  units: {theta: m}\n  start:")
    with pytest.raises(InputError, match="a full turn of sensor 'encoder'"):
        continued(rotor(tmp_path, text), episodes(TIMES, units={"theta": "m"}))
