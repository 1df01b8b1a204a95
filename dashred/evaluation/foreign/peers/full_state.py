"""What a method with the full state is given: all fields at all times, with noise."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from pathlib import Path
from typing import Any

import numpy as np

from dashred.config import load_config
from dashred.evaluation.foreign.cases.case import Array, LaterStates, Truth
from dashred.evaluation.foreign.cases.case_files import CONFIG, read_simulator
from dashred.physics.system import System, Term
from dashred.physics.terms.library import build_library

FULL = "full.npz"


@dataclass(frozen=True)
class FullState:
    """The full state of a case.

    Attributes:
        system: the simulator.
        library: candidate terms of the analysis.
        times: ``(time,)``.
        states: without noise, ``(time, field, *grid)``.
        noise: std of the noise as a share of that of each field.
        seed: of the noise and of the method.
        later: states a short time later, without noise, for the methods that are given pairs.
    """

    system: System
    library: list[Term]
    times: Array
    states: Array
    noise: float
    seed: int
    later: LaterStates | None = None

    @property
    def std(self) -> Array:
        """Standard deviation of each field, ``(field, *1)``."""
        flat = self.states.swapaxes(0, 1).reshape(self.states.shape[1], -1)
        return flat.std(axis=1).reshape(-1, *(1,) * (self.states.ndim - 2))

    @cached_property
    def noisy(self) -> Array:
        """The states with noise."""
        rng = np.random.default_rng([self.seed, *b"full"])
        return self.states + self.noise * self.std * rng.standard_normal(self.states.shape)


def write_full_state(folder: Path, truth: Truth, noise: float, seed: int) -> None:
    """Write the states of a case, beside its configuration."""
    stored: dict[str, Any] = {
        "times": truth.times,
        "states": truth.states,
        "noise": noise,
        "seed": seed,
    }
    if truth.later is not None:
        stored |= {"later": truth.later.states, "interval": truth.later.interval}
    np.savez(folder / FULL, **stored)


def read_full_state(folder: Path) -> FullState:
    """Read the states and the simulator of a case."""
    config, system = load_config([f"conf={folder / CONFIG}"], entry="train"), read_simulator(folder)
    with np.load(folder / FULL) as stored:
        later = None
        if "later" in stored:
            later = LaterStates(float(stored["interval"]), stored["later"])
        return FullState(
            system,
            build_library(system, config.library),
            stored["times"],
            stored["states"],
            float(stored["noise"]),
            int(stored["seed"]),
            later,
        )
