"""The nominal initial state of a simulation and its prior distribution."""

from __future__ import annotations

import math

import numpy as np
import torch
from torch import Tensor

from dashred.core.errors import InputError
from dashred.physics.backends.torch_backend import Program
from dashred.physics.expressions.algebra import Expr, names
from dashred.physics.expressions.parser import number
from dashred.physics.expressions.reflection import side
from dashred.physics.grids.grid import Grid
from dashred.physics.grids.grid_value import Value
from dashred.physics.grids.mesh import Mesh
from dashred.physics.runs.smooth_modes import smooth_modes
from dashred.physics.solvers.simulate import Progress, check_finite, simulate
from dashred.physics.system import System

# Largest share of the variance of a spread that an analysis omits: every mode is a column of each
# Jacobian. It is 1 % of the spread.
OMITTED = 1e-4


def nominal_start(system: System, progress: Progress | None = None) -> Tensor:
    """Return the nominal initial state ``(1, field, *grid)`` after the spin-up.

    Raises:
        InputError: a start expression is invalid, or the spin-up blows up.
    """
    state = stated_start(system)
    if not system.config.spin_up:
        return state
    times = torch.linspace(0.0, system.config.spin_up, 61, dtype=torch.float64)
    dt = system.config.spin_up_dt
    path = simulate(system.with_step(dt) if dt else system, state, times, progress=progress)
    check_finite(path, times, system)
    return path[:, -1]


def stated_start(system: System) -> Tensor:
    """Return the stated initial state ``(1, field, *grid)``, before the spin-up.

    Raises:
        InputError: a start expression is invalid.
    """
    expressions = [_start_expression(system, field) for field in system.fields]
    surroundings = system.coordinates_and_inputs(0.0, torch.device("cpu"))
    values = Program(expressions)(surroundings, system.operators)
    found = [torch.as_tensor(system.operators.on_grid(v), dtype=torch.float64) for v in values]
    for field, points in zip(system.fields, found, strict=True):
        if not torch.isfinite(points).all():
            where = system.where(f"system.start.{field}")
            raise InputError(f"the start of {field} is not finite everywhere", where=where)
    return torch.stack([f.expand(system.grid.shape) for f in found])[None]


def _start_expression(system: System, field: str) -> Expr:
    key = f"system.start.{field}"
    expr = system.ready(system.parse(system.config.start[field], key), field, key)
    if read := sorted(names(expr) & set(system.fields)):
        raise InputError(
            f"the start of {field} depends on the field {read[0]!r}, which has no value yet",
            where=system.where(key),
            hint="a start is a number, or an expression in coordinates and parameters",
        )
    return expr


def field_rms(states: Tensor) -> Tensor:
    """Return the rms of each field over states ``(time, field, *grid)``, ``(field,)``."""
    return states.transpose(0, 1).flatten(1).square().mean(dim=1).sqrt()


def spread_in_percent(system: System) -> bool:
    """Return whether the spread refers to the rms of the fields over a simulation."""
    return any(str(value).strip().endswith("%") for value in system.config.spread.values())


def gaussian_process_modes(grid: Grid | Mesh, length: float, count: int | None) -> Tensor:
    """Return Karhunen–Loève modes ``(mode, *grid)`` of a Gaussian process on rings or nodes.

    ``g = Σ zᵢ Bᵢ`` with z ~ N(0, 1) has unit variance and the covariance exp(-r²/2ℓ²), made
    periodic and normalised, for ℓ much shorter than the axes. With fewer modes both are slightly
    smaller. On rings the variance doubles at an insulated end and vanishes at a fixed end.

    Args:
        grid: with the points of g.
        length: correlation length ℓ, in the axes' unit.
        count: number of modes to keep, the strongest first; None for all.
    """
    strongest = smooth_modes(grid, length)
    whole = sum(power for power, _ in strongest)
    kept = strongest[:count]
    return torch.stack([mode() * math.sqrt(power / whole) for power, mode in kept])


def fitted_modes(system: System, omitted: float = OMITTED) -> int:
    """Return how many modes of a random start are fitted: as stated, or nearly all of its variance.

    Args:
        system: with the spread.
        omitted: share of the variance that is left out where nothing is stated.
    """
    stated = system.config.spread.get("modes")
    if stated is not None:
        return int(stated)
    powers = np.array([power for power, _ in smooth_modes(system.grid, spread_length(system))])
    last = np.count_nonzero(powers.cumsum() < (1 - omitted) * powers.sum())
    # Waves that differ in direction and phase alone have the same power: all of them or none.
    return int(np.count_nonzero(powers > 0.999 * powers[last]))


def spread_length(system: System) -> float:
    """Return the correlation length of a random start: stated, or a tenth of the longest axis."""
    longest = max((axis.length for axis in system.axes), default=1)
    return float(system.config.spread.get("length", 0.1 * longest))


class StartPrior:
    """Prior distribution of the initial state, from the configuration key ``system.spread``.

    Attributes:
        centre: nominal initial state, ``(field, *grid)``.
        size: number of independent standard normal variables z of one initial state.
        kept: number of Gaussian-process modes, as requested.

    Args:
        system: with names, grid and spread.
        centre: nominal initial state.
        rms: of each field over the nominal simulation, ``(field,)``; the reference of a spread
            in percent.
        modes: number of Gaussian-process modes to keep; None for all (a twin's truth).

    Raises:
        InputError: the spread is invalid.
    """

    def __init__(self, system: System, centre: Tensor, rms: Tensor, modes: int | None) -> None:
        self.system, self.centre = system, centre
        spread = system.config.spread
        self.moves = self._moves(dict(spread))
        self.basis = gaussian_process_modes(system.grid, spread_length(system), modes)
        self.shared = spread.get("kind") == "gaussian-process"
        self.rms, self.kept = rms, modes
        self.size = len(self.basis) * (1 if self.shared else len(self.moves))

    def start(self, z: Tensor) -> Tensor:
        """Return the initial states ``(batch, field, *grid)`` of ``z``, ``(batch, size)``."""
        per_field = z.reshape(len(z), self.size // len(self.basis), len(self.basis))
        g = torch.einsum("bfm,m...->bf...", per_field, self.basis)
        starts = self.centre.expand(len(z), *self.centre.shape).clone()
        if self.shared:
            return self._apply(starts, g[:, 0])
        for i, (field, amplitude) in enumerate(self.moves.items()):
            index = self.system.fields.index(field)
            starts[:, index] += g[:, i] * self._amplitude(field, amplitude)
        return starts

    def draw(self, count: int, rng: np.random.Generator) -> Tensor:
        """Return ``count`` random initial states."""
        return self.start(torch.from_numpy(rng.standard_normal((count, self.size))))

    def _moves(self, spread: dict[str, object]) -> dict[str, object]:
        apply = spread.get("apply")
        if isinstance(apply, dict):
            if "g" in self.system.names:
                raise InputError(
                    "spread.apply uses the random function g, but the system also has a name 'g'",
                    where=self.system.where("system.spread.apply"),
                    hint="rename it in the system, for example to 'gravity'",
                )
            return apply
        return {f: spread[f] for f in self.system.fields if f in spread}

    def _apply(self, starts: Tensor, g: Tensor) -> Tensor:
        system = self.system
        for axis in system.axes:
            if axis.ends == "fixed":
                # Expressions use the value on the axis itself, as for any field.
                g = g * system.grid.sides[side(axis.name)]
        values = system.values(starts, 0.0) | {"g": Value(g)}
        moved = starts.clone()
        for field, text in self.moves.items():
            key = f"system.spread.apply.{field}"
            parsed = system.parse(str(text), key, extra=frozenset({"g"}))
            expr = system.ready(parsed, field, key)
            [value] = Program([expr])(values, system.operators)
            moved[:, system.fields.index(field)] = torch.as_tensor(system.operators.on_grid(value))
        return moved

    def _amplitude(self, field: str, amplitude: object) -> float:
        where = self.system.where(f"system.spread.{field}")
        if isinstance(amplitude, str) and amplitude.strip().endswith("%"):
            percent = number(amplitude.strip()[:-1], where=where)
            return percent / 100 * float(self.rms[self.system.fields.index(field)])
        return number(str(amplitude), where=where)
