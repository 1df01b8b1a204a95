"""Streams of a small oscillator, and a tracker on its true law."""

from __future__ import annotations

import numpy as np
import torch
import yaml
from numpy.typing import NDArray

from dashred.config import Source, build_config
from dashred.config.source_dict import source_from_dict
from dashred.data.observation_operator import ObservationOperator
from dashred.data.recording import Recording
from dashred.data.sensors import Sensor
from dashred.inference.observer.march import March
from dashred.inference.streaming.calibration import Calibration, calibrate
from dashred.inference.streaming.live_estimator import LiveEstimator, LiveSettings
from dashred.inference.streaming.live_filter import LiveFilter
from dashred.inference.streaming.live_observer import LiveObserver
from dashred.inference.streaming.monitor import Monitor
from dashred.inference.streaming.tracker import Alarm, Tracker
from dashred.physics.solvers.simulate import simulate
from dashred.physics.system import System

Array = NDArray[np.float64]

# Van der Pol's oscillator: the orbit is stable, its phase is not.
TEXT = """
system:
  title: an oscillator
  fields: {x: place, p: momentum}
  parameters: {mu: 0.5}
  equations: {x: p, p: -x + mu*(1 - x**2)*p + LAW}
  start: {x: 1, p: 0}
  integrator: {method: rk4, dt: 0.05}
"""
SENSORS = (Sensor("place", "x"), Sensor("momentum", "p"))
EVERY, SIGMA = 0.1, 0.05


def system(law: str = "0") -> System:
    values = source_from_dict(yaml.safe_load(TEXT.replace("LAW", law)), "dict")
    config = build_config(values, Source({}, {"": "overrides"}), name="oscillator")
    return System(config.system, config.where)


def readings(samples: int, seed: int, law: str = "0") -> tuple[Array, Array]:
    """Return times and readings of both sensors with noise, ``(time, sensor)``."""
    oscillator, rng = system(law), np.random.default_rng(seed)
    times = EVERY * torch.arange(samples, dtype=torch.float64)
    start = torch.tensor([[1.0, 0.5]], dtype=torch.float64)
    path = simulate(oscillator, start, times)[0]
    values = ObservationOperator(SENSORS, oscillator)(path).numpy()
    return times.numpy(), values + SIGMA * rng.standard_normal(values.shape)


def recording(samples: int) -> Recording:
    return Recording(SENSORS, *readings(samples, seed=1))


def climate() -> Array:
    times = EVERY * torch.arange(300, dtype=torch.float64)
    start = torch.tensor([[1.0, 0.5]], dtype=torch.float64)
    return simulate(system(), start, times)[0].numpy()


def ensemble_filter(members: int = 30) -> LiveEstimator:
    noise = np.full(2, SIGMA)
    return LiveFilter(
        March(system()), SENSORS, (), noise, climate(), members, LiveSettings(), seed=0
    )


def observer() -> LiveEstimator:
    noise = np.full(2, SIGMA)
    return LiveObserver(
        March(system()), SENSORS, (), noise, climate(), EVERY, LiveSettings(), seed=0
    )


def calibrated(estimator: LiveEstimator) -> Calibration:
    """Calibrate an estimator on a recording of the true law."""
    return calibrate(estimator, *readings(300, seed=1))


def tracker(estimator: LiveEstimator, rate: float = 1e-4) -> Tracker:
    """Return a tracker whose estimator has not seen its stream."""
    known = calibrated(estimator)
    filter = known.filter
    filter.begin()
    return Tracker(filter, Monitor(known.innovations, known.serial, rate), settling=20)


def alarms(followed: Tracker, times: Array, values: Array) -> list[Alarm]:
    """Follow a stream; return its alarms."""
    found = [
        followed.add(float(time), EVERY, sample).alarm
        for time, sample in zip(times, values, strict=True)
    ]
    return [alarm for alarm in found if alarm is not None]
