"""SHRED of the public package ``pyshred``, trained on the simulation and applied to the recording.

The package is Williams, Zahn & Kutz, *Sensing with shallow recurrent decoder networks* (2024), with
the reduced order models of Tomasetto et al. (2025). It asks for numpy below 2, works with numpy 2,
and is therefore installed alone: ``pip install --no-deps pyshred``. It knows no missing readings:
they are replaced by the last known one of the sensor.
"""

from __future__ import annotations

import math
import time
from dataclasses import dataclass, replace
from importlib.metadata import version
from importlib.util import find_spec
from typing import Any

import numpy as np
import torch
from jaxtyping import Float

from dashred.evaluation.baselines.estimate import Estimate
from dashred.physics.runs.ensemble import Ensemble
from dashred.pipeline.problem import Problem

Array = np.ndarray
# Parts of the members for training, validation and test: the defaults of the package.
PARTS = (0.8, 0.1, 0.1)
MIN_MEMBERS = 10
# It trains for at most so many epochs, which is its default, and about so many seconds.
EPOCHS, SECONDS = 200, 600.0


@dataclass(frozen=True)
class Setting:
    """One setting of the package.

    Attributes:
        lags: samples of a history.
        modes: singular vectors of each field.
        noisy: whether the readings of the simulation have the noise of the sensors.
        batch: windows in a batch.
        rate: learning rate.
    """

    lags: int = 20
    modes: int = 50
    noisy: bool = False
    batch: int = 64
    rate: float = 1e-3


# Its authors': the defaults, with the readings of the simulation as they are.
RECOMMENDED = Setting()
# The tuned one is that among these which reconstructs the test members best from noisy readings.
_FAST = Setting(noisy=True, batch=512, rate=3e-3)
TUNED = (_FAST, replace(_FAST, lags=50), replace(_FAST, modes=200))


def is_installed() -> bool:
    """Return whether the package can be imported, without importing it."""
    return find_spec("pyshred") is not None


def pyshred_recommended(problem: Problem, ensemble: Ensemble) -> Estimate:
    """Return the field with the authors' settings.

    Args:
        problem: the recording.
        ensemble: plain simulations over the fit window.
    """
    return _estimate(problem, _train(problem, ensemble, RECOMMENDED))


def pyshred_tuned(problem: Problem, ensemble: Ensemble) -> Estimate:
    """Return the field with the setting that is best on held-out simulations.

    Args:
        problem: the recording.
        ensemble: plain simulations over the fit window.
    """
    all_trained = [_train(problem, ensemble, setting) for setting in TUNED]
    return _estimate(problem, min(all_trained, key=lambda trained: trained.test_error()))


@dataclass(frozen=True)
class _Trained:
    """A trained network of the package.

    Attributes:
        setting: its setting.
        epochs: epochs of its training.
        engine: the package's interface to it.
        states: states of the test members, ``(member, time, field, *grid)``.
        readings: their readings, with noise, ``(member, time, sensor)``.
    """

    setting: Setting
    epochs: int
    engine: Any
    states: Float[Array, "member time field ..."]
    readings: Float[Array, "member time sensor"]

    def field(self, readings: Float[Array, "time sensor"]) -> torch.Tensor:
        """Return the states that it reconstructs from readings, ``(time, field, *grid)``."""
        decoded = self.engine.decode(self.engine.sensor_to_latent(readings))
        fields = np.stack(list(decoded.values()), axis=1)
        shape = self.states.shape
        return torch.from_numpy(fields.reshape(-1, *shape[2:]).astype(np.float64))

    def test_error(self) -> float:
        """Return the RMSE over the test members, in standard deviations of each field."""
        others = tuple(i for i in range(self.states.ndim) if i != 2)
        scale = self.states.std(axis=others, keepdims=True)[0]
        pairs = zip(self.readings, self.states, strict=True)
        errors = [((self.field(each).numpy() - states) / scale) ** 2 for each, states in pairs]
        return math.sqrt(float(np.mean(errors)))

    def note(self) -> str:
        """Return a short description of the setting."""
        size = f"{self.setting.lags} lags, {self.setting.modes} modes"
        readings = f"{'noisy' if self.setting.noisy else 'exact'} readings"
        return f"{size}, {readings}, {self.epochs} epochs, pyshred {version('pyshred')}"


def _estimate(problem: Problem, trained: _Trained) -> Estimate:
    """Return the field that a network reconstructs from the recording."""
    return Estimate(trained.field(_filled(problem.split.fit.values)), None, trained.note())


def _train(problem: Problem, ensemble: Ensemble, setting: Setting) -> _Trained:
    from pyshred import ParametricDataManager, ParametricSHREDEngine

    states = np.asarray(ensemble.states[:], dtype=np.float64)
    members, samples = states.shape[:2]
    if members < MIN_MEMBERS:
        raise ValueError(f"it needs at least {MIN_MEMBERS} simulations, not {members}")
    exact, noisy = _readings(problem, ensemble)
    # The package draws from both generators.
    np.random.seed(problem.config.seed)
    torch.manual_seed(problem.config.seed)
    manager = ParametricDataManager(min(setting.lags, samples), *PARTS)
    for index in range(states.shape[2]):
        values = states[:, :, index].reshape(members, samples, -1)
        many = values.shape[-1] > setting.modes
        manager.add_data(
            data=values,
            id=problem.system.fields[index],
            measurements=(noisy if setting.noisy else exact) if index == 0 else None,
            compress=setting.modes if many else False,
        )
    training, validation, _ = manager.prepare()

    # The package has no limit of time, so that one epoch is timed first.
    began = time.perf_counter()
    _fit(training, validation, setting, 1)
    each = time.perf_counter() - began
    affordable = min(EPOCHS, max(1, int(SECONDS / each)))
    network, epochs = _fit(training, validation, setting, affordable)
    engine, tested = ParametricSHREDEngine(manager, network), manager.test_indices
    return _Trained(setting, epochs, engine, states[tested], noisy[tested])


def _fit(training: Any, validation: Any, setting: Setting, epochs: int) -> tuple[Any, int]:
    """Return a trained network of the package, and the epochs that it took."""
    from pyshred import SHRED

    network = SHRED()
    errors = network.fit(
        training,
        validation,
        batch_size=setting.batch,
        num_epochs=epochs,
        lr=setting.rate,
        verbose=False,
    )
    return network, len(errors)


def _readings(problem: Problem, ensemble: Ensemble) -> tuple[Array, Array]:
    """Return readings of the simulations, ``(member, time, sensor)``, without and with noise."""
    fit = problem.split.fit
    operator, sigma = problem.operator(fit), problem.noise_of(fit.names)
    exact = torch.stack(
        [operator(ensemble.states[:, i], time) for i, time in enumerate(ensemble.times.tolist())],
        dim=1,
    )
    generator = torch.Generator().manual_seed(problem.config.seed)
    noise = torch.randn(exact.shape, generator=generator, dtype=exact.dtype)
    return exact.numpy(), (exact + sigma * noise).numpy()


def _filled(values: Float[Array, "time sensor"]) -> Float[Array, "time sensor"]:
    """Return readings with each missing one replaced by the last known, or the first known."""
    filled = values.copy()
    for column in filled.T:
        known = np.flatnonzero(~np.isnan(column))
        if len(known) == 0:
            raise ValueError("a sensor has no reading")
        later = np.searchsorted(known, np.arange(len(column)), side="right")
        column[:] = column[known[np.maximum(later - 1, 0)]]
    return filled
