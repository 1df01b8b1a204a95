"""A law is told by the part of the structure that it changes."""

from __future__ import annotations

from pathlib import Path

import pytest

from dashred.discovery.candidates import Candidate
from dashred.discovery.structure_change import structure_changes
from dashred.physics.port_hamiltonian import PortHamiltonian
from dashred.physics.system import System
from tests import laws
from tests.physics.test_port_hamiltonian import (
    SPRING,
    SPRING_FORM,
    WAVE,
    WAVE_FORM,
    smooth,
)


def told(system: System, form: PortHamiltonian, *law: tuple[Candidate, float]) -> list[object]:
    found = laws.law([candidate for candidate, _ in law], [xi for _, xi in law])
    changes = structure_changes(form, found, smooth(system))
    return [(change.part, change.passive) for change in changes]


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
    assert told(system, form, (laws.term(system, equation, text), xi)) == [(part, passive)]


@pytest.mark.parametrize(
    ("name", "change", "part", "passive"),
    [("m", 0.3, "H", None), ("k", -0.3, "H", None), ("c", 0.3, "R", True), ("c", -0.5, "R", False)],
)
def test_a_parameter_of_a_spring(tmp_path: Path, name, change, part, passive) -> None:
    system = laws.declared(tmp_path, SPRING)
    form = PortHamiltonian.of(system, SPRING_FORM)
    parameter = Candidate(name, None, (), 1.0)
    assert told(system, form, (parameter, change)) == [(part, passive)]


def test_a_pair_that_moves_energy_about_is_of_j(tmp_path: Path) -> None:
    system = laws.declared(tmp_path, SPRING)
    form = PortHamiltonian.of(system, SPRING_FORM)
    # δH/δq = 3q, δH/δp = p/2: J gains 0.2 (and -0.2 back), times the other's effort.
    pair = ((laws.term(system, "q", "p"), 0.1), (laws.term(system, "p", "q"), -0.6))
    assert told(system, form, *pair) == [("J", None), ("J", None)]


def test_terms_of_waves(tmp_path: Path) -> None:
    system = laws.declared(tmp_path, WAVE)
    form = PortHamiltonian.of(system, WAVE_FORM)
    assert told(system, form, (laws.term(system, "v", "v"), -0.1)) == [("R", True)]
    assert told(system, form, (laws.term(system, "v", "w"), -0.1)) == [("H", None)]
    assert told(system, form, (laws.term(system, "v", "d(w, x, 4)"), -0.1)) == [("H", None)]
    assert told(system, form, (laws.term(system, "v", "d(w, x)"), -0.1)) == [(None, None)]
