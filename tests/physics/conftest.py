"""Systems declared in YAML, as by a user."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

import pytest

from dashred.config import load_config
from dashred.physics.system import System

REST = """
recording: {twin: a, sensors: 4, noise: 0, duration: 1, every: 0.1}
"""

MakeSystem = Callable[..., System]


@pytest.fixture
def make_system(tmp_path: Path) -> MakeSystem:
    """Make a system from the YAML text of its section, indented or not, and further words."""

    def make(text: str, *words: str) -> System:
        lines = text.strip("\n").splitlines()
        margin = min(len(line) - len(line.lstrip()) for line in lines if line.strip())
        body = "\n".join("  " + line[margin:] for line in lines)
        path = tmp_path / "declared.yaml"
        path.write_text(f"system:\n  title: declared in a test\n{body}\n{REST}")
        config = load_config([f"conf={path}", *words], entry="test")
        return System(config.system, config.where)

    return make


@pytest.fixture
def burgers(make_system: MakeSystem) -> System:
    """Viscous Burgers equation on a periodic axis of length 2π."""
    return make_system("""
        axes: {x: {length: 2*pi, points: 64}}
        fields: {u: velocity}
        parameters: {nu: 0.2}
        equations: {u: "-u*d(u, x) + nu*lap(u)"}
        start: {u: sin(x)}
        integrator: {dt: 0.02}
    """)


@pytest.fixture
def reaction(make_system: MakeSystem) -> System:
    """Two coupled fields on a periodic axis, with explicit coordinates and time."""
    return make_system("""
        axes: {x: {length: 5, points: 32}}
        fields: {u: activator, v: inhibitor}
        parameters: {D: 0.1, c: 0.3}
        let: {cubic: u - u**3/3}
        equations:
          u: cubic - v + D*lap(u) - c*d(u, x)
          v: 0.2*(u + 0.7 - 0.8*v) + 0.05*sin(2*pi*x/5 - t)
        start: {u: cos(2*pi*x/5), v: 0.2}
        spread: {u: 10%, v: 0.05, length: 1}
        integrator: {dt: 0.05}
    """)


@pytest.fixture
def plane(make_system: MakeSystem) -> System:
    """One field in two dimensions, on a grid with different axes."""
    return make_system("""
        axes: {x: {length: 2*pi, points: 16}, y: {length: 4*pi, points: 12}}
        fields: {w: vorticity}
        parameters: {nu: 0.1}
        equations: {w: "nu*lap(w) - 0.5*d(w, x) + 0.1*grad2(w)"}
        start: {w: cos(x)*sin(y/2)}
        integrator: {dt: 0.05}
    """)


@pytest.fixture
def oscillator(make_system: MakeSystem) -> System:
    """A damped oscillator, without space."""
    return make_system("""
        fields: {x: place, p: momentum}
        parameters: {k: 2.0}
        equations: {x: p, p: -k*x - 0.1*p}
        start: {x: 1, p: 0}
        spread: {x: 0.1, p: 5%}
        integrator: {dt: 0.05}
    """)
