"""Cases of mechanisms."""

from __future__ import annotations

import numpy as np
import pytest
import torch

from dashred.evaluation.foreign.cases.case import Case, Kind
from dashred.evaluation.foreign.cases.mechanics_cases import make_mechanics_case
from dashred.evaluation.foreign.cases.mechanisms import MECHANISMS
from tests.evaluation.foreign.invented import system_of


def case(system: str, kind: Kind, number: int = 0) -> Case:
    return Case("mechanics", system, kind, number, 0.02, 5)


@pytest.mark.parametrize("system", MECHANISMS)
def test_the_simulator_is_the_truth_without_the_hidden_force(system: str) -> None:
    """Compares derivatives of the trajectory with the simulator's tendency and the hidden one."""
    made = make_mechanics_case(case(system, "term"))
    simulator, truth = system_of(made.system), made.truth
    states = torch.from_numpy(truth.states)
    known = np.stack(
        [
            [
                float(simulator.evaluate(text, s, t))
                for s, t in zip(states, truth.times, strict=True)
            ]
            for text in made.system["equations"].values()
        ],
        axis=1,
    )
    rates = np.gradient(truth.states, truth.times, axis=0)
    error = np.median(np.abs(rates - known - truth.hidden), axis=0)
    assert (error < 0.05 * np.abs(rates).max(axis=0)).all()
    assert np.abs(truth.hidden).max() > 0.05


def test_the_hidden_law_is_the_hidden_tendency() -> None:
    made = make_mechanics_case(case("quadratic_drag", "term"))
    [term] = made.truth.terms
    states = torch.from_numpy(made.truth.states)
    column = system_of(made.system).evaluate(term.term, states).numpy() * term.coefficient
    np.testing.assert_allclose(column, made.truth.hidden[:, 1], atol=1e-6)


def test_nothing_is_hidden_where_nothing_is_to_be_hidden() -> None:
    truth = make_mechanics_case(case("backlash", "nothing")).truth
    assert truth.says == "nothing" and not truth.hidden.any() and truth.sensor is None


def test_one_sensor_errs_by_more_than_the_noise() -> None:
    made = make_mechanics_case(case("hysteresis", "sensor"))
    columns = [list(made.system["fields"]).index(sensor.field) for sensor in made.sensors]
    clean = made.truth.states[:, columns]
    error = np.abs(made.readings - clean).max(axis=0) / (0.02 * clean.std(axis=0))
    erring = [sensor.name for sensor in made.sensors].index(str(made.truth.sensor))
    assert error[erring] > 6 and np.delete(error, erring).max() < 5
    assert not made.truth.hidden.any()


def test_the_same_case_is_made_again() -> None:
    first, again = (make_mechanics_case(case("dry_friction", "term", 1)) for _ in range(2))
    np.testing.assert_array_equal(first.readings, again.readings)
