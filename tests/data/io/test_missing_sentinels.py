"""Sentinels of missing values are distinguished from real sensor values."""

from __future__ import annotations

import numpy as np

from dashred.data.io.missing_sentinels import mask_sentinels, sentinel_counts

SWING = np.round(np.cos(0.1 * np.arange(300)), 3)


def test_sentinels_are_found_and_removed() -> None:
    spoilt = SWING.copy()
    spoilt[[7, 80, 81]], spoilt[[120, 121]] = -999.0, 1e20
    assert sentinel_counts(spoilt) == {-999.0: 3, 1e20: 2}
    cleaned = mask_sentinels(np.stack([spoilt, SWING], axis=1))
    assert np.flatnonzero(np.isnan(cleaned[:, 0])).tolist() == [7, 80, 81, 120, 121]
    np.testing.assert_array_equal(cleaned[:, 1], SWING)


def test_what_a_sensor_may_read_is_no_mark() -> None:
    once, stuck, stairs = SWING.copy(), np.full(300, 2.0), SWING.copy()
    once[50], stairs[150:] = -999.0, 30.0
    forcing_basis = np.round(1000 * np.exp(-(((np.arange(300) % 60) - 30) ** 2) / 20) + SWING, 2)
    nothing = np.full(300, np.nan)
    for values in (SWING, once, stuck, stairs, forcing_basis, nothing):
        assert sentinel_counts(values) == {}
