"""A force is left where no law expresses what is missing, and none beside the right law."""

from __future__ import annotations

import numpy as np
from scipy.integrate import solve_ivp

from dashred.inference.segments.findings.force_map import force_map
from dashred.inference.segments.findings.segment_laws import law_from_segments
from dashred.inference.segments.segments import Array
from dashred.inference.segments.selection.left_force import force_beside, left_force
from tests.inference.segments.conftest import NOISE, TIMES, Convection, Find


def pulse(t: Array | float) -> Array:
    return 40 * np.exp(-((np.asarray(t) - 6) ** 2))


def test_the_right_law_leaves_no_force(convection: Convection, find: Find) -> None:
    found = find(convection.readings)
    assert left_force(found, found.walking(found.best)) is None
    assert force_beside(found, law_from_segments(found, found.best)) is None


def test_a_pulse_is_left_beside_the_law_and_drawn_over_time(
    convection: Convection, find: Find
) -> None:
    def tendency(t: float, u: Array) -> list[float]:
        x, y, z = u
        return [10 * (y - x), 28 * x - x * z - y, x * y - 8 / 3 * z + float(pulse(t))]

    states = solve_ivp(tendency, (0, TIMES[-1]), [-6, -9, 21], t_eval=TIMES, rtol=1e-9).y.T
    noise = NOISE * np.random.default_rng(1).standard_normal((len(TIMES), 2))
    clean = find(convection.readings)
    damping = law_from_segments(clean, clean.best)
    left = force_beside(find(states[:, :2] + noise), damping)
    assert left is not None
    assert left.gain > 100 and 0.1 < left.share < 1
    assert not left.force[:, 0].any() and left.force[:, 2].any()
    found = force_map(left)
    assert found is not None
    value, std = (each[2, 0].numpy() * left.rate[2] for each in (found.amplitudes, found.stds))
    exact = pulse(found.times.numpy())
    assert np.sqrt(np.mean(np.square(value - exact))) < 0.25 * exact.max()
    assert np.mean(np.abs(value - exact) < 3 * std) > 0.9
    assert abs(float(found.times[int(np.argmax(value))]) - 6) < 0.5
