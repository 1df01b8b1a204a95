"""The part of the structure that a law changes."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
import torch

from dashred.config import load_config
from dashred.inference.forward.candidates import Candidate
from dashred.inference.results.structure_change import stays_port_hamiltonian, structure_changes
from dashred.physics.backends.input_signals import InputSignals
from dashred.physics.port_hamiltonian import PortHamiltonian
from dashred.physics.sampled_states import SampledStates
from dashred.physics.system import System
from tests import laws
from tests.physics.test_port_hamiltonian import (
    SPRING,
    SPRING_FORM,
    WAVE,
    WAVE_FORM,
    smooth,
)

Part = tuple[str | None, bool | None]


def parts(system: System, form: PortHamiltonian, *law: tuple[Candidate, float]) -> list[object]:
    found = laws.law([candidate for candidate, _ in law], [xi for _, xi in law])
    changes = structure_changes(form, found, smooth(system))
    return [(change.part, change.passive) for change in changes]


def is_port_hamiltonian(
    system: System, form: PortHamiltonian, *law: tuple[Candidate, float]
) -> bool:
    found = laws.law([candidate for candidate, _ in law], [xi for _, xi in law])
    changes = structure_changes(form, found, smooth(system))
    return stays_port_hamiltonian(form, found, changes, smooth(system))


@pytest.mark.parametrize(
    ("equation", "text", "xi", "part", "passive"),
    [
        ("p", "p", -0.2, "R", True),
        ("p", "p", 0.2, "R", False),
        ("p", "abs(p)*p", -0.2, "R", True),
        ("p", "q**3", -0.5, "H", None),
        ("p", "q*p", 0.3, None, None),
        ("p", "1", 0.3, "H", None),
    ],
)
def test_a_term_of_a_spring(tmp_path: Path, equation, text, xi, part, passive) -> None:
    system = laws.declared(tmp_path, SPRING)
    form = PortHamiltonian.of(system, SPRING_FORM)
    assert parts(system, form, (laws.term(system, equation, text), xi)) == [(part, passive)]


@pytest.mark.parametrize(
    ("name", "change", "part", "passive"),
    [("m", 0.3, "H", None), ("k", -0.3, "H", None), ("c", 0.3, "R", True), ("c", -0.5, "R", False)],
)
def test_a_parameter_of_a_spring(tmp_path: Path, name, change, part, passive) -> None:
    system = laws.declared(tmp_path, SPRING)
    form = PortHamiltonian.of(system, SPRING_FORM)
    parameter = Candidate(name, None, (), 1.0)
    assert parts(system, form, (parameter, change)) == [(part, passive)]


def test_states_without_a_finite_structure_are_ignored(tmp_path: Path) -> None:
    system = laws.declared(tmp_path, SPRING.replace("c*p/m", "c*sqrt(q)*p/m"))
    form = PortHamiltonian.of(system, replace(SPRING_FORM, R={"p": {"p": "c*sqrt(q)"}}))
    parameter = Candidate("c", None, (), 1.0)
    assert parts(system, form, (parameter, 0.3)) == [("R", True)]
    assert is_port_hamiltonian(system, form, (parameter, 0.3))
    assert parts(system, form, (parameter, -0.5)) == [("R", False)]
    assert not is_port_hamiltonian(system, form, (parameter, -0.5))


def test_a_pair_that_exchanges_energy_belongs_to_j(tmp_path: Path) -> None:
    system = laws.declared(tmp_path, SPRING)
    form = PortHamiltonian.of(system, SPRING_FORM)
    # δH/δq = 3q, δH/δp = p/2: J gains 0.2 (and -0.2 back), times the other's effort.
    pair = ((laws.term(system, "q", "p"), 0.1), (laws.term(system, "p", "q"), -0.6))
    assert parts(system, form, *pair) == [("J", None), ("J", None)]


def test_terms_of_waves(tmp_path: Path) -> None:
    system = laws.declared(tmp_path, WAVE)
    form = PortHamiltonian.of(system, WAVE_FORM)
    assert parts(system, form, (laws.term(system, "v", "v"), -0.1)) == [("R", True)]
    assert parts(system, form, (laws.term(system, "v", "w"), -0.1)) == [("H", None)]
    assert parts(system, form, (laws.term(system, "v", "d(w, x, 4)"), -0.1)) == [("H", None)]
    assert parts(system, form, (laws.term(system, "v", "d(w, x)"), -0.1)) == [(None, None)]
    assert parts(system, form, (laws.term(system, "v", "lap(v)"), 0.1)) == [("R", True)]
    assert parts(system, form, (laws.term(system, "v", "lap(v)"), -0.1)) == [("R", False)]
    assert parts(system, form, (laws.term(system, "v", "d(v, x)"), 0.1)) == [("J", None)]
    assert parts(system, form, (laws.term(system, "v", "w*lap(w)"), 0.1)) == [(None, None)]


@pytest.mark.parametrize(
    ("text", "xi", "expected"),
    [
        ("1", 0.1, ("H", None)),
        ("w**2", 0.1, ("H", None)),
        ("w", -0.1, ("H", None)),
        ("d(w, x)", 0.1, (None, None)),
        ("p", -0.1, ("R", True)),
        ("lap(p)", 0.1, ("R", True)),
        ("d(p, x)", 0.1, ("J", None)),
        ("d(w, x, 2)", 0.1, ("H", None)),
        ("d(w, x, 4)", -0.1, ("H", None)),
    ],
)
def test_a_term_of_a_string_between_fixed_ends(text: str, xi: float, expected: Part) -> None:
    config = load_config(["conf=wave"], entry="test")
    system = System(config.system, config.where)
    assert system.config.structure is not None
    form = PortHamiltonian.of(system, system.config.structure)
    law = laws.law([laws.term(system, "p", text)], [xi])
    times = torch.linspace(0, 10, 20, dtype=torch.float64)
    # The first two standing waves, w = cos(kt) sin(kx).
    x = torch.arange(96, dtype=torch.float64) * 10 / 48
    k = torch.tensor([0.1, 0.2], dtype=torch.float64).reshape(2, 1, 1) * torch.pi
    w = torch.cos(k * times[:, None]) * torch.sin(k * x)
    p = -k * torch.sin(k * times[:, None]) * torch.sin(k * x)
    visited = SampledStates(torch.stack([w.sum(dim=0), p.sum(dim=0)], dim=1), times)
    [change] = structure_changes(form, law, visited)
    assert (change.part, change.passive) == expected
    kept = stays_port_hamiltonian(form, law, [change], visited)
    assert kept == (expected[0] is not None)


@pytest.mark.parametrize(
    ("equation", "text", "expected"),
    [
        ("phi", "V", ("G", None)),
        ("Q", "V", ("G", None)),
        ("phi", "V*Q", ("G", None)),
        ("phi", "V**2", (None, None)),
        ("phi", "phi", ("R", True)),
    ],
)
@pytest.mark.parametrize("amplitude", [0.0, 0.5])
def test_a_term_of_a_driven_circuit(
    equation: str, text: str, expected: Part, amplitude: float
) -> None:
    """The voltage begins at 0: at that time a term with it has no power."""
    config = load_config(["conf=rlc"], entry="test")
    times = torch.linspace(0, 20, 41, dtype=torch.float64)
    voltage = {"V": amplitude * np.sin(1.1 * times.numpy())}
    system = System(config.system, config.where, InputSignals(times.numpy(), voltage))
    assert system.config.structure is not None
    form = PortHamiltonian.of(system, system.config.structure)
    visited = SampledStates(torch.stack([torch.cos(times), -torch.sin(times)], dim=1), times)
    law = laws.law([laws.term(system, equation, text)], [-0.1])
    [change] = structure_changes(form, law, visited)
    assert (change.part, change.passive) == expected


def test_reduced_damping_is_judged_in_total(tmp_path: Path) -> None:
    """The spring dissipates ``c p/m = 0.2 p``: a law that adds less leaves it passive."""
    system = laws.declared(tmp_path, SPRING)
    form = PortHamiltonian.of(system, SPRING_FORM)
    linear, quadratic = (laws.term(system, "p", text) for text in ("p", "abs(p)*p"))
    assert is_port_hamiltonian(system, form, (linear, 0.1))
    assert not is_port_hamiltonian(system, form, (linear, 0.3))
    assert is_port_hamiltonian(system, form, (linear, 0.1), (quadratic, -0.1))
    assert not is_port_hamiltonian(system, form, (linear, 0.3), (quadratic, -0.1))
    assert is_port_hamiltonian(system, form, (Candidate("c", None, (), 1.0), -0.3))
    assert not is_port_hamiltonian(
        system, form, (Candidate("c", None, (), 1.0), -0.3), (linear, 0.1)
    )


def test_a_pair_is_skew_only_together(tmp_path: Path) -> None:
    system = laws.declared(tmp_path, SPRING.replace("c: 0.4", "c: 0.0"))
    form = PortHamiltonian.of(system, SPRING_FORM)
    given, taken = laws.term(system, "q", "p"), laws.term(system, "p", "q")
    assert is_port_hamiltonian(system, form, (given, 0.1), (taken, -0.6))
    assert not is_port_hamiltonian(system, form, (laws.term(system, "q", "q"), 0.1), (taken, -0.6))


def test_a_change_of_the_energy_is_not_dissipation(tmp_path: Path) -> None:
    """The damping dissipates the changed H; the corrected system would gain energy of the old H."""
    system = laws.declared(tmp_path, SPRING)
    form = PortHamiltonian.of(system, SPRING_FORM)
    cubic, damping = laws.term(system, "p", "q**3"), laws.term(system, "p", "p")
    assert is_port_hamiltonian(system, form, (cubic, -0.5))
    assert is_port_hamiltonian(system, form, (cubic, -0.5), (damping, -0.1))
    assert is_port_hamiltonian(system, form, (Candidate("m", None, (), 1.0), 0.3), (damping, -0.1))


def test_growing_short_waves_are_detected_without_samples(tmp_path: Path) -> None:
    """``-0.1 v - 0.01 v_xx`` damps only waves longer than 2, and only these were sampled."""
    system = laws.declared(tmp_path, WAVE)
    form = PortHamiltonian.of(system, WAVE_FORM)
    uniform = laws.term(system, "v", "v")
    viscous = laws.term(system, "v", "lap(v)")
    assert is_port_hamiltonian(system, form, (uniform, -0.1), (viscous, 0.01))
    assert not is_port_hamiltonian(system, form, (uniform, -0.1), (viscous, -0.01))
