"""A convection model in three modes whose damping the simulator leaves out; chaotic."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace

import numpy as np
import pytest
from scipy.integrate import solve_ivp

from dashred.data.sensors import Sensor
from dashred.inference.forward.candidates import Candidate
from dashred.inference.segments.first_nodes import first_nodes
from dashred.inference.segments.natural_scales import field_sizes, natural_scales
from dashred.inference.segments.segments import Array, Segments, cut
from dashred.inference.segments.selection.search import SegmentSearch, search
from dashred.inference.segments.state_sensors import StateSensors
from dashred.inference.segments.steps.segment_simulator import SegmentSimulator
from dashred.inference.segments.weak_constraint import WeakConstraintProblem
from dashred.physics.system import System
from tests import laws

TEXT = """
system:
  title: convection in three modes
  fields: {x: flow, y: temperature across, z: temperature up}
  equations: {x: 10*(y - x), y: 28*x - x*z, z: x*y - 8/3*z}
  start: {x: -6, y: -9, z: 21}
  spread: {x: 1, y: 1, z: 1}
  integrator: {method: rk4, dt: 0.005}
recording: {twin: a, sensors: 2, noise: 0, duration: 4, every: 0.05}
"""
TERMS = ("x", "y", "z", "x*y", "x*z", "y*z", "x**2", "sin(y)")
TIMES = np.linspace(0, 12, 241)
NOISE = 0.15
MEAN, SPREAD = np.array([[-6.5, -9.4, 21.5]]), np.full(3, 3.0)


# The candidates of `find`.
NAMES = ("x: x", "x: y*z", "y: x", "y: y", "y: x*z", "z: x", "z: z", "z: x*y")
Find = Callable[..., SegmentSearch]


@dataclass(frozen=True)
class Convection:
    """The recording and its simulator.

    Attributes:
        system: without the damping of y.
        candidates: terms of its three equations.
        states: of the complete system, ``(time, field)``.
        readings: of x and y, ``(time, sensor)``.
    """

    system: System
    candidates: tuple[Candidate, ...]
    states: Array
    readings: Array

    @property
    def segments(self) -> Segments:
        """The recording, cut."""
        return cut([TIMES], [self.readings])

    @property
    def simulator(self) -> SegmentSimulator:
        """The simulator over the segments."""
        return SegmentSimulator([self.system], self.segments, 4)

    @property
    def sensors(self) -> StateSensors:
        """The sensors of x and y."""
        return StateSensors((Sensor("x", "x"), Sensor("y", "y")), self.system)

    def index(self, name: str) -> int:
        """Return the index of a candidate, ``equation: term``."""
        return [str(candidate) for candidate in self.candidates].index(name)


def weak_problem(convection: Convection) -> WeakConstraintProblem:
    """F without walks."""
    return WeakConstraintProblem(
        simulator=convection.simulator,
        sensors=convection.sensors,
        candidates=convection.candidates,
        noise_std=np.full(2, NOISE),
        model_error=np.full(3, 0.1),
        start_mean=MEAN,
        start_std=SPREAD,
        prior_std=np.ones(len(convection.candidates)),
    )


@pytest.fixture(scope="session")
def convection(tmp_path_factory: pytest.TempPathFactory) -> Convection:
    system = laws.declared(tmp_path_factory.mktemp("convection"), TEXT)
    candidates = tuple(laws.term(system, f, text) for f in system.fields for text in TERMS)

    def tendency(_: float, u: Array) -> list[float]:
        x, y, z = u
        return [10 * (y - x), 28 * x - x * z - y, x * y - 8 / 3 * z]

    states = solve_ivp(
        tendency, (0, TIMES[-1]), [-6, -9, 21], t_eval=TIMES, rtol=1e-10, atol=1e-10
    ).y.T
    noise = NOISE * np.random.default_rng(1).standard_normal((len(TIMES), 2))
    return Convection(system, candidates, states, states[:, :2] + noise)


@pytest.fixture
def find(convection: Convection) -> Find:
    """Search the law of readings of x and y, ``(time, sensor)`` of each episode."""

    def run(*readings: Array, least_std: float = 0.0) -> SegmentSearch:
        count = len(readings)
        segments = cut([TIMES] * count, readings)
        simulator = SegmentSimulator([convection.system] * count, segments, 4)
        sensors, means = convection.sensors, np.repeat(MEAN, count, axis=0)
        size = field_sizes(segments, sensors, np.full(3, 8.0))
        guesses = first_nodes(simulator, sensors, means, size)
        chosen = tuple(convection.candidates[convection.index(name)] for name in NAMES)
        scales = natural_scales(simulator, sensors, chosen, guesses[-1], size, np.full(2, NOISE))
        problem = replace(
            weak_problem(convection),
            simulator=simulator,
            candidates=chosen,
            start_mean=means,
            prior_std=np.ones(len(chosen)),
            least_std=least_std,
        )
        return search(problem, guesses, scales)

    return run
