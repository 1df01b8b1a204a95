"""The observation operator, compared with closed forms."""

from __future__ import annotations

import itertools
import math

import pytest
import torch

from dashred.core.errors import InputError
from dashred.data.observation_operator import ObservationOperator
from dashred.data.sensors import Sensor


def sensors_at(*positions, reads="u"):
    return [Sensor(f"s{i}", reads, tuple(p)) for i, p in enumerate(positions)]


def two_fields(u):
    return torch.stack((u, torch.zeros_like(u)))


def waves(x, length, top, phase=0.3):
    """Return a field with all modes up to ``top``."""
    k = torch.arange(top + 1, dtype=torch.float64)
    return (torch.cos(2 * math.pi * k * x[..., None] / length + phase * k) / (1 + k)).sum(-1)


@pytest.mark.parametrize("points", [16, 17])
def test_trigonometric_interpolation_is_exact_below_the_nyquist_mode(make_system, points):
    system = make_system(("x", 3.0, points))
    nodes = torch.arange(points, dtype=torch.float64) * 3.0 / points
    places = torch.tensor([0.0, 0.1234, 1.5, 2.9999, 3.0], dtype=torch.float64)
    read = ObservationOperator(sensors_at(*places[:, None].tolist()), system)
    state = two_fields(waves(nodes, 3.0, 7))
    torch.testing.assert_close(read(state), waves(places, 3.0, 7), rtol=0, atol=1e-13)


def test_trigonometric_interpolation_takes_the_nyquist_mode_as_a_cosine(make_system):
    system = make_system(("x", 1.0, 8))
    zigzag = torch.tensor([1.0, -1.0] * 4, dtype=torch.float64)
    read = ObservationOperator(sensors_at((0.0,), (1 / 16,), (1 / 8,)), system)
    expected = torch.tensor([1.0, 0.0, -1.0], dtype=torch.float64)
    torch.testing.assert_close(read(two_fields(zigzag)), expected)


def test_trigonometric_interpolation_is_exact_in_two_dimensions(make_system):
    system = make_system(("x", 2.0, 12), ("y", 5.0, 10))
    x = torch.arange(12, dtype=torch.float64)[:, None] / 6
    y = torch.arange(10, dtype=torch.float64)[None, :] / 2
    places = torch.tensor([[0.31, 4.2], [1.97, 0.01], [1.0, 2.5]], dtype=torch.float64)
    read = ObservationOperator(sensors_at(*places.tolist()), system)
    field = waves(x, 2.0, 5) * waves(y, 5.0, 4, phase=1.1)
    expected = waves(places[:, 0], 2.0, 5) * waves(places[:, 1], 5.0, 4, phase=1.1)
    torch.testing.assert_close(read(two_fields(field)), expected, rtol=0, atol=1e-13)


def test_linear_interpolation_converges_with_order_two(make_system):
    places = torch.rand(50, generator=torch.Generator().manual_seed(1), dtype=torch.float64)
    errors = []
    for points in (32, 64, 128):
        system = make_system(("x", 1.0, points), spectral=False)
        nodes = torch.arange(points, dtype=torch.float64) / points
        read = ObservationOperator(sensors_at(*places[:, None].tolist()), system)
        state = two_fields(torch.sin(2 * math.pi * nodes))
        difference = read(state) - torch.sin(2 * math.pi * places)
        errors.append(difference.square().mean().sqrt())
    orders = [math.log2(coarse / fine) for coarse, fine in itertools.pairwise(errors)]
    assert min(orders) > 1.8


def test_linear_interpolation_wraps_round_the_end_of_the_axis(make_system):
    system = make_system(("x", 1.0, 8), spectral=False)
    ramp = torch.arange(8, dtype=torch.float64)
    read = ObservationOperator(sensors_at((15 / 16,), (1.0,)), system)
    torch.testing.assert_close(read(two_fields(ramp)), torch.tensor([3.5, 0.0]).double())


def test_sensors_keep_their_order_whatever_they_read(ring):
    generator = torch.Generator().manual_seed(2)
    state = torch.randn(3, 4, 2, 16, generator=generator, dtype=torch.float64)
    reads = ["v", "u", "speed", "u", "v"]
    sensors = [Sensor(f"s{i}", r, (2.0 * i / 16,)) for i, r in enumerate(reads)]
    seen = ObservationOperator(sensors, ring)(state, 0.5)
    u, v = state[..., 0, :], state[..., 1, :]
    by_hand = {"u": u, "v": v, "speed": u**2 + 0.5 * v}
    expected = torch.stack([by_hand[r][..., i] for i, r in enumerate(reads)], dim=-1)
    assert seen.shape == (3, 4, 5)
    torch.testing.assert_close(seen, expected)


def test_sensors_of_fields_are_linear_and_those_of_derived_quantities_are_not(ring):
    fields = ObservationOperator([*sensors_at((0.2,)), *sensors_at((1.3,), reads="v")], ring)
    assert fields.is_linear
    derived = [*sensors_at((0.2,)), *sensors_at((1.3,), reads="speed")]
    assert not ObservationOperator(derived, ring).is_linear


def test_a_system_without_space_is_read_directly(ode):
    sensors = [Sensor("b", "v"), Sensor("a", "u"), Sensor("c", "speed")]
    read = ObservationOperator(sensors, ode)
    state = torch.tensor([[2.0, 5.0], [3.0, 7.0]])
    assert read(state, 1.0).tolist() == [[5.0, 2.0, 9.0], [7.0, 3.0, 16.0]]
    assert read(state[0]).shape == (3,)


def test_gradients_pass_through_interpolation_and_derived_quantities(ring):
    read = ObservationOperator(sensors_at((0.2,), (1.3,), reads="speed"), ring)
    state = torch.randn(2, 2, 16, dtype=torch.float64, requires_grad=True)
    assert torch.autograd.gradcheck(lambda s: read(s, 0.4), (state,))


def test_the_dtype_of_the_state_is_kept(ring):
    read = ObservationOperator(sensors_at((0.2,)), ring)
    state = torch.randn(2, 16, dtype=torch.float64)
    assert read(state.float()).dtype is torch.float32
    torch.testing.assert_close(read(state.float()).double(), read(state), atol=1e-5, rtol=0)
    assert read(state).dtype is torch.float64


def test_no_sensors_read_nothing(ring):
    assert ObservationOperator([], ring)(torch.zeros(5, 2, 16)).shape == (5, 0)


def test_an_impossible_sensor_is_refused(ring):
    with pytest.raises(InputError, match="outside the axis"):
        ObservationOperator(sensors_at((2.5,)), ring)
