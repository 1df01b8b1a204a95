"""The structure of a system makes its equations, or is refused where it does not."""

from __future__ import annotations

from pathlib import Path

import pytest
import torch

from dashred.core.errors import InputError
from dashred.physics.expressions.algebra import to_text
from dashred.physics.port_hamiltonian import PortHamiltonian, variational_derivative
from dashred.physics.sampled_states import SampledStates, evaluate
from dashred.physics.system import System
from dashred.physics.system_schema import Structure
from tests import laws

SPRING = """
system:
  title: mass on a spring
  fields: {q: place, p: momentum}
  parameters: {m: 2.0, k: 3.0, c: 0.4}
  equations: {q: p/m, p: -k*q - c*p/m}
  start: {q: 1, p: 0}
  integrator: {method: rk4, dt: 0.01}
recording: {twin: a, sensors: 1, noise: 0, duration: 1, every: 0.1}
"""
WAVE = """
system:
  title: waves on a ring
  axes: {x: {length: 6, points: 32}}
  fields: {w: height, v: velocity}
  parameters: {c: 1.5}
  equations: {w: v, v: "c**2*d(w, x, 2)"}
  start: {w: cos(pi*x/3), v: 0}
  integrator: {dt: 0.01}
recording: {twin: a, sensors: 4, noise: 0, duration: 1, every: 0.1}
"""
CANONICAL = {"q": {"p": "1"}, "p": {"q": "-1"}}
SPRING_FORM = Structure(H="p**2/(2*m) + k*q**2/2", J=CANONICAL, R={"p": {"p": "c"}})
WAVE_FORM = Structure(H="v**2/2 + c**2*grad2(w)/2", J={"w": {"v": "1"}, "v": {"w": "-1"}})


@pytest.fixture
def spring(tmp_path: Path) -> System:
    return laws.declared(tmp_path, SPRING)


@pytest.fixture
def wave(tmp_path: Path) -> System:
    return laws.declared(tmp_path, WAVE)


def smooth(system: System) -> SampledStates:
    generator = torch.Generator().manual_seed(1)
    states = torch.randn((5, len(system.fields), 7), generator=generator, dtype=torch.float64)
    times = torch.linspace(0, 1, 5, dtype=torch.float64)
    if not system.axes:
        return SampledStates(states[..., 0], times)
    x = 2 * torch.pi * system.grid.coordinates["x"] / system.axes[0].length
    waves = torch.stack([torch.cos(j * x + j) for j in range(7)])
    return SampledStates(torch.einsum("sfj,j...->sf...", states, waves), times)


def test_the_structure_of_a_spring_makes_its_equations(spring: System) -> None:
    form = PortHamiltonian.of(spring, SPRING_FORM)
    form.check(smooth(spring))
    assert {f: to_text(e) for f, e in form.effort.items()} == {"q": "3*q", "p": "0.5*p"}


def test_the_structure_of_waves_makes_their_equations(wave: System) -> None:
    PortHamiltonian.of(wave, WAVE_FORM).check(smooth(wave))


def test_a_variation_is_the_energys_slope_in_any_direction(wave: System) -> None:
    text = "sin(v)*w**2 + grad2(w)**2/4 + v*d(w, x, 2) + d(v, x)**2*w"
    density = wave.parse(text, "H")
    slopes = variational_derivative(wave, density)
    states, now = smooth(wave).states, torch.zeros(1, dtype=torch.float64)
    at, towards, h = states[:1], states[1:2], 1e-5
    spacing = wave.axes[0].spacing
    ahead, behind = (
        float(evaluate(wave, density, SampledStates(at + sign * h * towards, now)).sum()) * spacing
        for sign in (1, -1)
    )
    efforts = [evaluate(wave, slopes[f], SampledStates(at, now)) for f in wave.fields]
    effort = torch.stack(efforts, dim=1)
    exact = float((effort * towards).sum()) * spacing
    assert (ahead - behind) / (2 * h) == pytest.approx(exact, rel=1e-6)


@pytest.mark.parametrize(
    ("form", "says"),
    [
        (Structure(H="p**2/(2*m)", J=CANONICAL, R={"p": {"p": "c"}}), "but the equation is"),
        (Structure(H=SPRING_FORM.H, J={"q": {"p": "1"}}), "not skew"),
        (Structure(H=SPRING_FORM.H, J=CANONICAL, R={"p": {"p": "-c"}}), "not positive"),
        (Structure(H=SPRING_FORM.H, J=CANONICAL, R={"p": {"q": "c"}}), "not symmetric"),
        (Structure(H=SPRING_FORM.H, J=CANONICAL, R={"p": {"p": "c*sqrt(q)"}}), "R is not finite"),
    ],
)
def test_a_structure_that_is_none_is_refused(spring: System, form: Structure, says: str) -> None:
    with pytest.raises(InputError, match=says):
        PortHamiltonian.of(spring, form).check(smooth(spring))


def test_a_name_that_is_no_field_is_refused(spring: System) -> None:
    with pytest.raises(InputError, match="J names r"):
        PortHamiltonian.of(spring, Structure(H="p**2", J={"q": {"r": "1"}}))
