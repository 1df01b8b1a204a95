"""SHRED of the package pyshred: what it is given, and which setting is taken."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import pytest
import torch

from dashred.evaluation.baselines import pyshred_field
from dashred.evaluation.baselines.pyshred_field import (
    TUNED,
    Setting,
    pyshred_recommended,
    pyshred_tuned,
)
from dashred.physics.runs.ensemble import Ensemble


@dataclass
class Trained:
    """A trained network that returns the number of its lags everywhere."""

    setting: Setting
    error: float

    def field(self, readings: np.ndarray) -> torch.Tensor:
        """Return the states."""
        return torch.full((len(readings), 2), float(self.setting.lags))

    def test_error(self) -> float:
        """Return the given error."""
        return self.error

    def note(self) -> str:
        """Return the number of lags."""
        return f"{self.setting.lags} lags"


def test_the_setting_that_is_best_on_simulations_is_taken(swing, monkeypatch) -> None:
    problem, _, ensemble = swing["null"]
    errors = dict(zip(TUNED, (0.3, 0.1, 0.2), strict=True))
    monkeypatch.setattr(
        pyshred_field,
        "_train",
        lambda given, members, setting: Trained(setting, errors.get(setting, 1.0)),
    )
    found = pyshred_tuned(problem, ensemble)
    assert found.note == "50 lags" and bool((found.states == 50).all())
    assert pyshred_recommended(problem, ensemble).note == "20 lags"


def test_a_missing_reading_is_the_last_one_that_is_known() -> None:
    nan = np.nan
    filled = pyshred_field._filled(np.array([[nan, 1.0], [2.0, nan], [nan, nan], [3.0, 4.0]]))
    np.testing.assert_array_equal(filled, [[2, 1], [2, 1], [2, 1], [3, 4]])
    with pytest.raises(ValueError, match="no reading"):
        pyshred_field._filled(np.array([[nan], [nan]]))


def test_the_readings_are_those_of_the_simulations_with_the_noise_of_the_sensors(swing) -> None:
    problem, _, ensemble = swing["null"]
    exact, noisy = pyshred_field._readings(problem, ensemble)
    np.testing.assert_allclose(exact[:, :, 0], ensemble.states[:, :, 0])
    sigma = float(problem.noise_of(problem.split.fit.names)[0])
    assert (noisy - exact).std() == pytest.approx(sigma, rel=0.1)


def test_the_package_learns_a_field_that_few_readings_determine(swing, monkeypatch) -> None:
    pytest.importorskip("pyshred", reason="pyshred asks for numpy below 2")
    problem, _, ensemble = swing["null"]
    monkeypatch.setattr(pyshred_field, "EPOCHS", 8)
    found = pyshred_recommended(problem, ensemble)
    count = len(problem.split.fit.times)
    assert found.states.shape == (count, 2) and found.terms is None
    assert "20 lags, 50 modes, exact readings" in found.note
    # The place is measured, the momentum is not. Nothing is hidden, so that the simulation holds.
    measured = torch.from_numpy(problem.split.fit.values[:, 0])
    assert float((found.states[20:, 0] - measured[20:]).std()) < 0.3 * float(measured.std())


def test_too_few_simulations_are_refused(swing, monkeypatch) -> None:
    pytest.importorskip("pyshred", reason="pyshred asks for numpy below 2")
    problem, _, ensemble = swing["null"]
    few = Ensemble(ensemble.times, ensemble.states[:5], ensemble.coefficients[:5])
    with pytest.raises(ValueError, match="at least 10 simulations"):
        pyshred_recommended(problem, few)


def test_it_is_left_out_where_it_is_not_installed(monkeypatch) -> None:
    monkeypatch.setattr(pyshred_field, "find_spec", lambda name: None)
    assert not pyshred_field.is_installed()
