"""Streams of a damped oscillator that a measured voltage drives."""

from __future__ import annotations

import numpy as np
import torch
import yaml
from numpy.typing import NDArray

from dashred.config import Source, build_config
from dashred.config.source_dict import source_from_dict
from dashred.data.inputs import with_inputs
from dashred.data.recording import Recording
from dashred.data.sensors import Sensor
from dashred.physics.backends.input_signals import InputSignals
from dashred.physics.solvers.simulate import simulate
from dashred.physics.system import System

Array = NDArray[np.float64]

TEXT = """
system:
  title: a driven oscillator
  fields: {x: place, p: momentum}
  equations: {x: p, p: -x - 0.3*p + V}
  inputs: {V: voltage}
  start: {x: 1, p: 0}
  integrator: {method: rk4, dt: 0.05}
"""
SENSORS = (Sensor("place", "x"),)
EVERY, SIGMA = 0.1, 0.05


def system(text: str = TEXT) -> System:
    values = source_from_dict(yaml.safe_load(text), "dict")
    config = build_config(values, Source({}, {"": "overrides"}), name="driven")
    return System(config.system, config.where)


def voltage(times: Array) -> Array:
    """Return the input, which has no period."""
    return np.sin(0.7 * times) + 0.6 * np.sin(1.9 * times + 1)


def states(samples: int, begin: float = 0.0) -> tuple[Array, Array]:
    """Return times and states of the oscillator, ``(time, field)``."""
    times = begin + EVERY * np.arange(samples, dtype=np.float64)
    driven = with_inputs(system(), InputSignals(times, {"voltage": voltage(times)}))
    start = torch.tensor([[1.0, 0.5]], dtype=torch.float64)
    return times, simulate(driven, start, torch.from_numpy(times))[0].numpy()


def readings(samples: int, seed: int, begin: float = 0.0) -> tuple[Array, Array]:
    """Return times and readings of the place with noise, ``(time, 1)``."""
    times, path = states(samples, begin)
    noise = SIGMA * np.random.default_rng(seed).standard_normal((samples, 1))
    return times, path[:, :1] + noise


def recording(samples: int) -> Recording:
    times, values = readings(samples, seed=1)
    return Recording(SENSORS, times, values, InputSignals(times, {"voltage": voltage(times)}))


def climate() -> Array:
    return states(300)[1]
