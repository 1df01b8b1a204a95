"""A time step just above the limit of stability is refused, and one just below is not."""

from __future__ import annotations

import math
from pathlib import Path
from typing import Any

import pytest
import torch
import yaml

from dashred.config import load_config
from dashred.physics.runs.initial_state_prior import nominal_start
from dashred.physics.runs.step_stability import Along, is_stable
from dashred.physics.system import System

# Ends of the intervals of stability of rk4 and ssprk3 on the negative real axis.
RK4, SSPRK3 = 2.785, 2.5127
CELLS = 8
ABOVE, BELOW = 1.02, 0.98


def chain() -> dict[str, Any]:
    """Return diffusion along a ring of cells, by the method of lines."""
    names = [f"u{i}" for i in range(CELLS)]
    around = [(names[i - 1], names[i], names[(i + 1) % CELLS]) for i in range(CELLS)]
    return {
        "fields": {name: name for name in names},
        "equations": {own: f"100*({left} - 2*{own} + {right})" for left, own, right in around},
        "start": dict.fromkeys(names, 1.0),
        "spread": dict.fromkeys(names, 0.1),
        "integrator": {"method": "rk4", "dt": 1.0},
    }


def system_of(folder: Path, document: dict[str, Any]) -> System:
    recording = {"twin": "a", "sensors": 4, "noise": 0, "duration": 1, "every": 0.1}
    path = folder / "declared.yaml"
    path.write_text(yaml.safe_dump({"system": {"title": "t", **document}, "recording": recording}))
    config = load_config([f"conf={path}"], entry="test")
    return System(config.system, config.where)


def verdict(folder: Path, document: dict[str, Any], dt: float, steps: int = 1000) -> bool:
    system = system_of(folder, document).with_step(dt)
    along = Along(
        nominal_start(system), torch.zeros(1, dtype=torch.float64), steps * dt, steps * dt
    )
    return is_stable(system, along)


def test_a_stiff_diffusion_in_rk4(tmp_path: Path) -> None:
    limit = RK4 / 400  # The fastest mode of the ring has the eigenvalue -4*100.
    assert verdict(tmp_path, chain(), BELOW * limit)
    assert not verdict(tmp_path, chain(), ABOVE * limit)


def test_a_diffusion_of_finite_differences_in_ssprk3(tmp_path: Path) -> None:
    document = {
        "axes": {"x": {"length": 1, "points": 16}},
        "fields": {"u": "heat"},
        "equations": {"u": "0.3*d(u, x, 2)"},
        "start": {"u": "1 + 0.5*cos(2*pi*x)"},
        "spread": {"u": 0.1, "length": 0.2},
        "integrator": {"space": "finite-difference", "dt": 1.0},
    }
    system = system_of(tmp_path, document)
    wave = torch.cos(math.pi * torch.arange(16, dtype=torch.float64))[None, None]
    fastest = -float(system.evaluate("0.3*d(u, x, 2)", wave)[0, 0])
    assert fastest > 0
    limit = SSPRK3 / fastest
    assert verdict(tmp_path, document, BELOW * limit)
    assert not verdict(tmp_path, document, ABOVE * limit)


def test_a_nonlinear_wave_whose_dispersion_is_explicit(tmp_path: Path) -> None:
    """``i ψ_t = -ψ_xx/2 - |ψ|² ψ``: its fastest wave has the frequency k²/2."""
    document = {
        "axes": {"x": {"length": "2*pi", "points": 32}},
        "fields": {"p": "real part", "q": "imaginary part"},
        "equations": {
            "p": "-0.5*lap(q) - (p**2 + q**2)*q",
            "q": "0.5*lap(p) + (p**2 + q**2)*p",
        },
        "start": {"p": "1 + 0.1*cos(x)", "q": "0.1*sin(x)"},
        "spread": {"p": 0.1, "q": 0.1, "length": 0.5},
        "integrator": {"dt": 1.0, "dealias": False},
    }
    limit = math.sqrt(8) / (16**2 / 2)
    assert verdict(tmp_path, document, 0.9 * limit)
    assert not verdict(tmp_path, document, 1.1 * limit)


def test_an_instability_of_the_simulator_itself_is_kept(tmp_path: Path) -> None:
    document = {
        "fields": {"x": "x", "y": "y"},
        "equations": {"x": "3*x + y", "y": "2*y"},
        "start": {"x": 1e-9, "y": 1e-9},
        "spread": {"x": 0.1, "y": 0.1},
        "integrator": {"method": "rk4", "dt": 1.0},
    }
    assert verdict(tmp_path, document, 0.05)


@pytest.mark.parametrize("ends", ["insulated", "fixed", {"value": 0}])
def test_exponential_steps_of_diffusion_have_no_limit(tmp_path: Path, ends: Any) -> None:
    document = {
        "axes": {"x": {"length": 1, "points": 16, "ends": ends}},
        "fields": {"u": "heat"},
        "equations": {"u": "0.3*d(u, x, 2)"},
        "start": {"u": "sin(pi*x)"},
        "spread": {"u": 0.1, "length": 0.2},
        "integrator": {"dt": 1.0},
    }
    if isinstance(ends, dict):
        document["axes"]["x"]["ends"] = {"left": ends, "right": dict(ends)}  # type: ignore[index]
    assert verdict(tmp_path, document, 1.0)


def test_a_short_record_has_no_growth(tmp_path: Path) -> None:
    assert verdict(tmp_path, chain(), 1.0, steps=4)


def test_a_state_at_the_edge_of_the_equations_says_nothing(tmp_path: Path) -> None:
    """The root of a level below zero is undefined, so an empty tank cannot be perturbed."""
    tanks = {
        "fields": {"h": "upper tank", "low": "lower tank"},
        "equations": {"h": "0.5 - sqrt(h)", "low": "sqrt(h) - sqrt(low)"},
        "start": {"h": 0.0, "low": 0.0},
        "spread": {"h": 0.1},
        "integrator": {"method": "rk4", "dt": 1.0},
    }
    assert verdict(tmp_path, tanks, 0.01)
    full = tanks | {"start": {"h": 0.25, "low": 0.25}}
    assert verdict(tmp_path, full, 0.01)
    # There the Jacobian has twice the eigenvalue -1/(2 sqrt(0.25)) = -1.
    assert not verdict(tmp_path, full, 1.1 * RK4)
