"""Compile the integrators of a kind of system, so that no later stage has to.

The machine code of an integrator is the same for all systems of its kind: ODE systems, spectral
systems with as many axes, and finite volumes. Numba compiles it once and keeps it beside the
modules of the installation. The functions of a system's own equations are compiled later.
"""

from __future__ import annotations

from dataclasses import replace

import torch

from dashred.inference.forward.candidate_simulator import CandidateSimulator
from dashred.physics import system_schema as schema
from dashred.physics.boundaries.entries import one_sided_axis
from dashred.physics.solvers.compiled.step_factors import compile_step_factors
from dashred.physics.solvers.forcing import Forcing
from dashred.physics.system import System, Term

POINTS = 8


def compile_integrators(config: schema.System) -> None:
    """Compile the integrators of trajectories and derivatives that a system needs.

    They run one step of a small system of the same kind.

    Args:
        config: any system; nothing is compiled for snapshots, for nodes, or for methods that are
            not compiled.
    """
    if config.snapshots is not None or config.nodes is not None:
        return
    small = System(_small(config), lambda key: key)
    simulator = CandidateSimulator(small, small.dt, [])
    if simulator.has_tangents:
        start = torch.ones((1, 1, *small.grid.shape), dtype=torch.float64)
        times = torch.tensor([0.0, small.dt], dtype=torch.float64)
        weights = torch.zeros((1, 0), dtype=torch.float64)
        simulator.run(start, times, weights)
        source = (Term("u", small.resolved["u"]),)
        nothing = Forcing((), weights)
        columns = simulator.tangents(start[0], start, times, nothing, [source], None, None, weights)
        for _ in columns:
            pass
    if small.spectral:
        compile_step_factors()


def _small(config: schema.System) -> schema.System:
    """Return a system with the same axes, on few points, and the same integrator."""
    sides = {"left": "insulated", "right": "insulated"} if one_sided_axis(config) else None
    axes = {
        name: replace(
            axis,
            length=1.0,
            points=POINTS,
            ends=sides or axis.ends,
            coordinates="cartesian",
        )
        for name, axis in config.axes.items()
    }
    equation = f"lap(u) - u*d(u, {next(iter(axes))})" if axes else "-u**2"
    return schema.System(
        title="compilation",
        axes=axes,
        fields={"u": "u"},
        equations={"u": equation},
        start={"u": 1},
        integrator=replace(config.integrator, dt=0.01),
    )
