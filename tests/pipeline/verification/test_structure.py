"""The structures that bundled systems claim hold on their own simulations."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
import torch

from dashred.config import load_config
from dashred.core.errors import InputError
from dashred.inference.fit.law import FittedParameter
from dashred.inference.forward.candidates import ChangePrior
from dashred.physics.backends.input_signals import InputSignals
from dashred.physics.runs.initial_state_prior import nominal_start
from dashred.physics.solvers.simulate import simulate
from dashred.physics.system import System
from dashred.pipeline.verification.structure import check_structure, structure_change
from tests import laws


@pytest.mark.parametrize("name", ["mass_spring", "wave"])
def test_a_bundled_structure_makes_the_equations(name: str) -> None:
    config = load_config([f"conf={name}"], entry="test")
    system = System(config.system, config.where)
    assert system.config.structure is not None
    times = torch.linspace(0, 3, 16, dtype=torch.float64)
    check_structure(system, times, simulate(system, nominal_start(system), times)[0])


@pytest.mark.parametrize(("gain", "says"), [("1", None), ("-1", "the structure gives")])
def test_a_port_is_held_against_the_drive_that_was_measured(gain: str, says: str | None) -> None:
    """The drive is 0 at t = 0: a wrong sign shows at other times alone."""
    config = load_config(["conf=rlc"], entry="test")
    assert config.system.structure is not None
    structure = replace(config.system.structure, G={"phi": {"V": gain}})
    times = torch.linspace(0, 3, 16, dtype=torch.float64)
    drive = InputSignals(times.numpy(), {"V": np.sin(times.numpy())})
    system = System(replace(config.system, structure=structure), config.where, drive)
    states = torch.stack([torch.cos(times), -torch.sin(times)], dim=1)
    if says is None:
        check_structure(system, times, states)
        return
    with pytest.raises(InputError, match=says):
        check_structure(system, times, states)


@pytest.mark.parametrize(("change", "stays"), [(0.0, True), (-0.5, False)])
def test_a_fitted_damping_counts_beside_the_law(change: float, stays: bool) -> None:
    """A damping below zero adds energy, whatever the law removes."""
    config = load_config(["conf=mass_spring"], entry="test")
    assert config.system.structure is not None
    damped = replace(
        config.system,
        parameters={**config.system.parameters, "c": 0.1},
        equations={"q": "p/m", "p": "-k*q - c*p/m"},
        structure=replace(config.system.structure, R={"p": {"p": "c"}}),
    )
    system = System(damped, config.where)
    times = torch.linspace(0, 3, 16, dtype=torch.float64)
    states = simulate(system, nominal_start(system), times)[0]
    damping = replace(laws.parameter(system, "c"), prior=ChangePrior(0.0, 1.0))
    found = replace(
        laws.law([laws.term(system, "p", "p")], [-0.001]),
        parameters=(FittedParameter(damping, change, 0.01),),
    )
    changes = structure_change(system, found, times, states)
    assert changes is not None and changes["port_hamiltonian"] == stays


def test_an_even_force_on_a_string_between_fixed_ends_is_of_a_structure() -> None:
    config = load_config(["conf=wave"], entry="test")
    assert config.system.structure is not None
    heavy = replace(
        config.system,
        equations={"w": "p/rho", "p": "sigma*lap(w) - 0.1"},
        structure=replace(config.system.structure, H=f"{config.system.structure.H} + 0.1*w"),
    )
    system = System(heavy, config.where)
    times = torch.linspace(0, 3, 16, dtype=torch.float64)
    check_structure(system, times, simulate(system, nominal_start(system), times)[0])
