"""Trajectories and tangents in torch against those of NumPy and of compiled code."""

from __future__ import annotations

import pytest
import torch
from torch import Tensor

from dashred.physics.forcing_basis import ForcingBasis, SampledForcing
from dashred.physics.runs.initial_state_prior import nominal_start
from dashred.physics.solvers.compiled.etdrk4 import CompiledETDRK4
from dashred.physics.solvers.compiled_simulator import DeviceSystem, compile_system
from dashred.physics.solvers.forcing import Forcing
from dashred.physics.solvers.simulate import simulate
from dashred.physics.system import System, Term
from dashred.physics.tangents.on_device import spectral_tangents
from dashred.physics.tangents.on_device.spectral_tangents import tangents_on_device
from dashred.physics.tangents.tangent_linear import tangent_linear
from dashred.physics.terms.library import resolve
from tests.spectral_systems import PLANE, REACTION, TIMES

CUDA = pytest.param(
    "cuda", marks=pytest.mark.skipif(not torch.cuda.is_available(), reason="no CUDA device")
)
DECAY = """
    axes: {x: {length: 2*pi, points: 16}}
    fields: {u: height}
    equations: {u: 0.1*lap(u)}
    start: {u: cos(x)}
    integrator: {dt: 0.05}
"""
LAW = {
    "reaction": [("u", "u**3"), ("u", "d(v, x, 2)"), ("v", "d(u, x)*v"), ("v", "d(v, x, 3)")],
    "plane": [("w", "grad2(w)"), ("w", "lap(w**3)"), ("w", "d(w, x)")],
    "decay": [("u", "d(u, x, 3)")],
}
SOURCES = {
    "reaction": [[("u", "u*v"), ("v", "1")], [("u", "d(v, x)")], [("v", "u*v"), ("v", "d(v, x)")]],
    "plane": [[("w", "w**2")], [("w", "w*lap(w**2)")], [("w", "lap(lap(w))")]],
    "decay": [[("u", "u**2")], [("u", "u")]],
}


class Case:
    """A system with a law, sources, directions and a free forcing, all of one trajectory."""

    def __init__(self, name: str, system: System) -> None:
        self.system = system
        self.terms = self._terms(LAW[name])
        self.sources = [self._terms(several) for several in SOURCES[name]]
        self.weights = 0.03 * torch.arange(1.0, len(self.terms) + 1, dtype=torch.float64)[None]
        self.basis = ForcingBasis.over(system, TIMES, 3, 2)
        generator = torch.Generator().manual_seed(1)
        amplitudes = torch.randn((1, *self.basis.shape), generator=generator).double()
        self.forced = self.basis.sampled_forcing(0.1 * amplitudes)
        shape = (3, len(system.fields), *system.grid.shape)
        self.directions = torch.randn(shape, generator=generator).double()

    def _terms(self, listed: list[tuple[str, str]]) -> tuple[Term, ...]:
        parse = self.system.parse
        return resolve(
            self.system, [Term(e, parse(text, "test", equation=e)) for e, text in listed]
        )

    def arguments(self, dtype: torch.dtype, forced: SampledForcing | None):
        """Return the arguments of tangents, without the system."""
        start, law = nominal_start(self.system)[0], Forcing(self.terms, self.weights)
        basis = self.basis if forced else None
        return start, self.directions, TIMES, law, self.sources, dtype, forced, basis

    def on(self, device: str) -> System:
        """Return the system on a device."""
        system = self.system
        return System(system.config, system.where, system.input_signals, torch.device(device))


@pytest.fixture(params=["reaction", "plane", "decay"])
def case(request, make_system) -> Case:
    text = {"reaction": REACTION, "plane": PLANE, "decay": DECAY}[request.param]
    return Case(request.param, make_system(text))


def joined(samples) -> tuple[Tensor, Tensor]:
    states, columns = zip(*samples, strict=True)
    return torch.stack(states).cpu(), torch.stack(columns).cpu()


@pytest.mark.parametrize("device", ["cpu", CUDA])
@pytest.mark.parametrize("is_forced", [False, True])
def test_tangents_are_those_of_numpy(case, is_forced, device, monkeypatch):
    monkeypatch.setattr(spectral_tangents, "POINTS_AT_ONCE", 2**10)
    arguments = case.arguments(torch.float64, case.forced if is_forced else None)
    states, columns = joined(tangent_linear(case.system, *arguments))
    same, found = joined(tangents_on_device(case.on(device), *arguments))
    torch.testing.assert_close(same, states, rtol=1e-11, atol=1e-11)
    torch.testing.assert_close(found, columns, rtol=1e-9, atol=1e-9)


def test_columns_may_be_integrated_in_parts(case, monkeypatch):
    arguments = case.arguments(torch.float64, case.forced)
    _, whole = joined(tangents_on_device(case.system, *arguments))
    monkeypatch.setattr(spectral_tangents, "COLUMN_POINTS", 2 * nominal_start(case.system).numel())
    _, parts = joined(tangents_on_device(case.system, *arguments))
    torch.testing.assert_close(parts, whole, rtol=1e-12, atol=1e-12)


def test_single_precision_is_close(case):
    _, exact = joined(tangents_on_device(case.system, *case.arguments(torch.float64, None)))
    _, found = joined(tangents_on_device(case.system, *case.arguments(torch.float32, None)))
    assert found.dtype == torch.float32
    assert float((found - exact).norm() / exact.norm()) < 1e-5


@pytest.mark.parametrize("device", [CUDA])
@pytest.mark.parametrize("is_forced", [False, True])
def test_trajectories_are_those_of_the_cpu(case, is_forced, device):
    start = torch.cat([nominal_start(case.system), 0.9 * nominal_start(case.system)])
    law = Forcing(case.terms, torch.cat([case.weights, 0 * case.weights]))
    values = case.forced.values.repeat_interleave(2, dim=0)
    forced = SampledForcing(case.forced.knots, values) if is_forced else None
    expected = simulate(case.system, start, TIMES, law, sampled_forcing=forced)
    found = simulate(case.on(device), start, TIMES, law, sampled_forcing=forced)
    assert found.device == start.device
    torch.testing.assert_close(found, expected, rtol=1e-11, atol=1e-11)


@pytest.mark.parametrize("name", ["cpu", "cuda"])
def test_only_the_cpu_has_compiled_code(make_system, name):
    case = Case("decay", make_system(DECAY))
    run = compile_system(case.on(name), case.terms)
    assert isinstance(run, CompiledETDRK4 if name == "cpu" else DeviceSystem)
