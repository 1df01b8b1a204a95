"""Noise that depends on the reading."""

from __future__ import annotations

import numpy as np
import pytest
import torch

from dashred.core.errors import InputError
from dashred.core.stated.noise import NoiseLaw, parse_noise
from dashred.data.episodes import Episode, Episodes
from dashred.data.recording import Recording
from dashred.data.sensors import Sensor
from dashred.data.stated.relative_noise import neighbour_mean, noise_at, relative_noise
from dashred.data.stated.stated_noise import resolve_shares
from dashred.inference.fit.noise_model import NoiseModel
from dashred.inference.segments.segments import cut

TIMES = np.arange(100.0)


@pytest.mark.parametrize(
    ("given", "law"),
    [
        ("5% of reading", NoiseLaw(0.0, 0.05)),
        (" 0.1 + 2 % of the reading ", NoiseLaw(0.1, 0.02)),
        ("counts", NoiseLaw(0.5, 0.0, 1.0)),
    ],
)
def test_a_noise_that_depends_on_the_reading(given: str, law: NoiseLaw) -> None:
    std, share, found = parse_noise(given, "std", "here")
    assert std is None and share is None and found is not None
    assert tuple(found) == pytest.approx(tuple(law))


@pytest.mark.parametrize("given", ["5% of", "-1 + 5% of reading", "of reading", "5 of reading"])
def test_other_texts_are_refused(given: str) -> None:
    with pytest.raises(InputError, match="must be a positive number or share"):
        parse_noise(given, "std", "here")


def test_the_law() -> None:
    np.testing.assert_allclose(noise_at(NoiseLaw(3.0, 0.5), np.array([0.0, -8.0])), [3.0, 5.0])
    np.testing.assert_allclose(noise_at(NoiseLaw(0.0, 0.0, 1.0), np.array([4.0, 9.0])), [2.0, 3.0])


def test_the_level_is_that_of_the_neighbours() -> None:
    values = np.array([[0.0], [1.0], [np.nan], [3.0], [4.0]])
    expected = [2.0, 7 / 3, 2.0, 5 / 3, 2.0]
    np.testing.assert_allclose(neighbour_mean(values)[:, 0], expected)
    assert neighbour_mean(np.array([[5.0]])) == 5.0


def test_sizes_relative_to_the_rms_noise() -> None:
    values = np.column_stack([np.linspace(1, 50, 100), np.ones(100)])
    sensors = (Sensor("a", "a", noise_law=NoiseLaw(0.0, 0.1)), Sensor("b", "b", std=0.2))
    whole = Episodes((Episode("", Recording(sensors, TIMES, values)),))
    recording = resolve_shares(whole, 1, 0.2).episodes[0].recording
    first = recording.sensors[0]
    assert first.std is not None
    early = values[:80, 0]
    assert first.std == pytest.approx(0.1 * np.sqrt(np.mean(early**2)), rel=1e-3)
    sizes = relative_noise(recording)
    assert sizes is not None
    np.testing.assert_allclose(sizes[5:95, 0] * first.std, 0.1 * values[5:95, 0], rtol=0.01)
    np.testing.assert_array_equal(sizes[:, 1], 1.0)
    assert relative_noise(recording.select(["b"])) is None
    shifted = relative_noise(recording, np.full(values.shape, 10.0))
    assert shifted is not None and shifted[10, 0] > sizes[10, 0]


def test_residuals_are_whitened_by_their_own_noise() -> None:
    sizes = torch.linspace(0.2, 2.0, 400, dtype=torch.float64)[:, None]
    noise = torch.randn((400, 1), generator=torch.Generator().manual_seed(2), dtype=torch.float64)
    std, none = torch.tensor([0.5]).double(), torch.zeros(1).double()
    model = NoiseModel(std, none, torch.ones((400, 1), dtype=torch.bool), sizes)
    residuals = 1.5 * sizes * noise
    torch.testing.assert_close(model.whiten(residuals), 3 * noise)
    estimated = model.estimate(residuals, ["a"], 0.0)
    assert float(estimated.std) == pytest.approx(1.5, rel=0.08) and estimated.relative is sizes
    assert float(estimated.truncate(10).whiten(residuals[:10]).std()) == pytest.approx(1, rel=0.6)


def test_segments_carry_the_sizes() -> None:
    times, readings = [TIMES[:10], TIMES[:7]], [np.ones((10, 1)), np.ones((7, 1))]
    sizes = [np.arange(10.0)[:, None], np.arange(10.0, 17.0)[:, None]]
    segments = cut(times, readings, 4, sizes)
    assert not isinstance(segments.relative, float)
    seen = segments.available
    assert sorted(segments.relative[seen].tolist()) == [*range(17)]
    assert cut(times, readings, 4).relative == 1.0
    only = segments.only(0)
    np.testing.assert_array_equal(only.relative, segments.relative[:1])
