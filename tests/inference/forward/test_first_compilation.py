"""After the first compilation no integrator is compiled again, for any kind of system."""

from __future__ import annotations

from pathlib import Path

import pytest
import torch

from dashred.config import load_config
from dashred.inference.forward.candidate_simulator import CandidateSimulator
from dashred.inference.forward.candidates import build_candidates, build_forcing
from dashred.inference.forward.first_compilation import compile_integrators
from dashred.physics.cells import compiled_step as cells
from dashred.physics.grids import full_spectrum
from dashred.physics.solvers.compiled import runge_kutta as ode
from dashred.physics.solvers.compiled import step as spectral
from dashred.physics.solvers.compiled import step_factors
from dashred.physics.system import System
from dashred.physics.tangents import ode_columns
from dashred.physics.tangents.spectral_columns import kernels
from dashred.physics.terms.library import build_library

COMPILED = (
    ode._integrate,
    ode_columns.integrate_columns,
    spectral.integrate_row,
    spectral.integrate_stages,
    cells.integrate_batch,
    cells.integrate_stages,
    kernels.advance_groups,
    full_spectrum._complete,
    step_factors._fill,
)
KINDS = {
    "ode": ("", "x: v, v: -k*sin(x)", "x: 1, v: 0"),
    "line": ("x: {length: 2, points: 16}", "u: k*lap(u) - u*d(u, x), w: u", "u: sin(pi*x), w: 1"),
    "transport": ("x: {length: 2, points: 16}", "u: k*lap(u) - d(u, x)", "u: sin(pi*x)"),
    "plane": (
        "x: {length: 2, points: 8}, y: {length: 2, points: 8}",
        "u: k*lap(u) - u**2",
        "u: sin(pi*x)",
    ),
    "sides": (
        "x: {length: 2, points: 12, ends: {left: insulated, right: {value: 2}}}",
        "u: k*d(u, x, 2) - u**3",
        "u: 2",
    ),
    "radius": (
        "r: {length: 2, points: 12, ends: insulated, coordinates: radial}",
        "u: k*lap(u) - u**3",
        "u: 2",
    ),
    "adaptive": ("", "x: -k*x", "x: 1"),
}


def declared(folder: Path, kind: str) -> System:
    """Return a system as a user would declare it."""
    axes, equations, start = KINDS[kind]
    fields = ", ".join(f"{part.split(':')[0]}: a field" for part in start.split(", "))
    method = "dopri5" if kind == "adaptive" else "null"
    path = folder / f"{kind}.yaml"
    path.write_text(
        f"system:\n  title: any\n  axes: {{{axes}}}\n  fields: {{{fields}}}\n"
        f"  parameters: {{k: 0.1}}\n  equations: {{{equations}}}\n  start: {{{start}}}\n"
        f"  integrator: {{dt: 0.02, method: {method}}}\n"
        "recording: {twin: a, sensors: 3, noise: 0, duration: 1, every: 0.1}\n"
    )
    config = load_config([f"conf={path}"], entry="test")
    return System(config.system, config.where)


@pytest.mark.parametrize("kind", KINDS)
def test_nothing_is_compiled_after_the_first_compilation(tmp_path: Path, kind: str) -> None:
    system = declared(tmp_path, kind)
    compile_integrators(system.config)
    before = [len(function.nopython_signatures) for function in COMPILED]
    start = torch.ones((3, len(system.fields), *system.grid.shape), dtype=torch.float64)
    library = build_library(system, {system.fields[0]: ["1", f"{system.fields[0]}**2"]})
    candidates = build_candidates(system, library, start, 0.0)
    simulator = CandidateSimulator(system, system.dt, candidates)
    times = torch.tensor([0.0, 0.1, 0.2], dtype=torch.float64)
    weights = simulator.weights(candidates, torch.full((3, len(candidates)), 1e-3).double())
    assert torch.isfinite(simulator.run(start, times, weights)).all()
    if simulator.has_tangents:
        law = build_forcing(candidates, torch.full((1, len(candidates)), 1e-3).double())
        sources = [candidate.terms for candidate in candidates]
        columns = simulator.tangents(
            start[0], start[:2], times, law, sources, None, None, weights[:1]
        )
        assert len(list(columns)) == len(times)
    assert [len(function.nopython_signatures) for function in COMPILED] == before


def test_a_first_compilation_is_quick_when_repeated(tmp_path: Path) -> None:
    config = declared(tmp_path, "line").config
    compile_integrators(config)
    before = [len(function.nopython_signatures) for function in COMPILED]
    compile_integrators(config)
    assert [len(function.nopython_signatures) for function in COMPILED] == before
