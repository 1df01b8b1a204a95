"""Stand-ins for systems, without any physics."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np
import pytest
from torch import Tensor

from dashred.data.recording import Recording
from dashred.data.sensors import Sensor
from dashred.physics.grids.grid import Axis, Grid


@dataclass(frozen=True)
class PlainSystem:
    """A system with fields ``u, v`` and one derived quantity, ``speed = u² + t·v``."""

    axes: tuple[Axis, ...] = ()
    spectral: bool = True
    fields: tuple[str, ...] = ("u", "v")
    lets: tuple[str, ...] = ("speed",)
    inputs: dict[str, str] = field(default_factory=dict)
    held_inputs: tuple[str, ...] = ()
    units: dict[str, str] = field(default_factory=dict)
    where: Callable[[str], str] = "conf.yaml, {}".format

    @property
    def grid(self) -> Grid:
        """The grid of the axes."""
        return Grid(self.axes)

    def contains(self, place: Sequence[float], /) -> bool:
        """Every place is in the domain."""
        return self.grid.contains(place)

    def evaluate(self, name: str, state: Tensor, t: float, /) -> Tensor:
        """Evaluate the derived quantity."""
        assert name == "speed"
        fields = state.movedim(-1 - len(self.axes), 0)
        return fields[0] ** 2 + t * fields[1]


@pytest.fixture
def ode() -> PlainSystem:
    """A system without space."""
    return PlainSystem()


@pytest.fixture
def ring() -> PlainSystem:
    """A periodic axis x of length 2, 16 points."""
    return PlainSystem((Axis("x", 2.0, 16),))


@pytest.fixture
def make_system() -> Callable[..., PlainSystem]:
    """Make a system of (name, length, points) for each axis."""

    def make(*axes: tuple[str, float, int], spectral: bool = True) -> PlainSystem:
        return PlainSystem(tuple(Axis(*axis) for axis in axes), spectral)

    return make


@pytest.fixture
def write(tmp_path: Path) -> Callable[[str, str | bytes], str]:
    """Write a file in the test's folder and return its path."""

    def written(name: str, contents: str | bytes) -> str:
        path = tmp_path / name
        path.write_bytes(contents if isinstance(contents, bytes) else contents.encode())
        return str(path)

    return written


@pytest.fixture
def make_recording() -> Callable[..., Recording]:
    """Make a recording of sensors s0, s1, … of u, evenly placed on [0, 2)."""

    def make(sensors: int = 12, samples: int = 101, step: float = 0.1) -> Recording:
        times = step * np.arange(samples, dtype=np.float64)
        places = 2.0 * np.arange(sensors) / sensors
        values = np.sin(times[:, None] + np.pi * places)
        named = (Sensor(f"s{index}", "u", (float(x),)) for index, x in enumerate(places))
        return Recording(tuple(named), times, values)

    return make
