"""Innovations with known statistics become white noise; white noise stays as it is."""

from __future__ import annotations

import numpy as np
import pytest

from dashred.inference.streaming.whitening import Whitener


def coloured(samples: int, seed: int) -> np.ndarray:
    """Return noise with mean 0.4, standard deviation 1.6 and correlation 0.6."""
    noise = np.random.default_rng(seed).standard_normal(samples)
    values = np.empty(samples)
    values[0] = noise[0]
    for i in range(1, samples):
        values[i] = 0.6 * values[i - 1] + 0.8 * noise[i]
    return 0.4 + 1.6 * values[:, None]


def test_coloured_innovations_are_whitened() -> None:
    whitener = Whitener.fit(coloured(4000, seed=0))
    assert whitener.is_needed.all()
    white = np.array([whitener.add(sample)[0] for sample in coloured(4000, seed=1)])
    assert white.mean() == pytest.approx(0.0, abs=0.1)
    assert white.std() == pytest.approx(1.0, abs=0.05)
    assert np.corrcoef(white[1:], white[:-1])[0, 1] == pytest.approx(0.0, abs=0.05)


def test_white_noise_is_left_as_it_is() -> None:
    noise = np.random.default_rng(2).standard_normal((500, 2))
    whitener = Whitener.fit(noise)
    assert not whitener.is_needed.any()
    assert whitener.add(noise[0]) is noise[0] or (whitener.add(noise[0]) == noise[0]).all()


def test_the_scale_follows_a_stream_slowly() -> None:
    rng = np.random.default_rng(3)
    whitener = Whitener.fit(1.5 * rng.standard_normal((2000, 1)))
    louder = 2.25 * rng.standard_normal((6000, 1))
    white = np.array([whitener.add(sample)[0] for sample in louder])
    assert white[:100].std() > 1.3
    assert white[-3000:].std() == pytest.approx(1.0, abs=0.1)


def test_missing_innovations_stay_missing() -> None:
    whitener = Whitener.fit(coloured(2000, seed=0))
    assert np.isnan(whitener.add(np.array([np.nan]))).all()
    assert np.isfinite(whitener.add(np.array([1.0]))).all()


def test_a_few_innovations_show_nothing() -> None:
    assert not Whitener.fit(np.full((5, 1), 3.0)).is_needed.any()
