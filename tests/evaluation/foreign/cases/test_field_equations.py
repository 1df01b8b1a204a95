"""The table of fields: what may be left out is in the equations, and the simulators are valid."""

from __future__ import annotations

import numpy as np
import pytest

from dashred.evaluation.foreign.cases.field_cases import _system
from dashred.evaluation.foreign.cases.field_equations import FIELD_EQUATIONS, FieldEquation
from dashred.evaluation.foreign.cases.hidden_in_fields import all_terms, known_terms, leave_out
from dashred.physics.terms.library import build_library
from tests.evaluation.foreign.invented import config_of, system_of


@pytest.mark.parametrize("name", FIELD_EQUATIONS)
def test_every_removable_term_is_a_term(name: str) -> None:
    equation = FIELD_EQUATIONS[name]
    assert equation.removable and set(equation.start) == set(equation.terms)
    for removed in equation.removable.values():
        for field, text in removed.items():
            assert text in equation.terms[field]


def hidden_of(equation: FieldEquation, effect: str):
    """Draw until this effect is drawn."""
    for seed in range(200):
        hidden = leave_out(equation, np.random.default_rng(seed))
        if hidden.says.startswith(f"{effect}:"):
            return hidden
    raise AssertionError(effect)


@pytest.mark.parametrize("name", FIELD_EQUATIONS)
def test_every_simulator_is_valid_and_lacks_what_is_left_out(name: str) -> None:
    equation = FIELD_EQUATIONS[name]
    shape = (len(equation.terms), *(equation.points,) * len(equation.axes))
    for effect, removed in equation.removable.items():
        hidden = hidden_of(equation, effect)
        assert all_terms(equation, hidden) == dict(equation.terms)
        known = known_terms(equation, hidden)
        for field, terms in equation.terms.items():
            assert len(known[field]) == len(terms) - (field in removed)
        section = _system(equation, hidden, np.random.default_rng(0).random(shape))
        system = system_of(section)
        assert len(build_library(system, config_of(section).library)) > 10
        for term in hidden.terms:
            system.resolve(system.parse(term.term, "terms", equation=term.equation), "terms")
