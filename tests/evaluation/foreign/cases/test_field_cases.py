"""Cases of fields; they need the extra ``evaluation``."""

from __future__ import annotations

import numpy as np
import pytest
import torch

from dashred.evaluation.foreign.cases.case import Case, Kind
from dashred.evaluation.foreign.cases.field_cases import make_field_case
from dashred.evaluation.foreign.cases.fitted_sensors import fitted_sensors
from dashred.physics.solvers.simulate import simulate
from tests.evaluation.foreign.invented import system_of

pytest.importorskip("pde", reason="py-pde is in the extra evaluation")


def case(kind: Kind, number: int = 0, system: str = "fisher") -> Case:
    return Case("fields", system, kind, number, 0.02, 5)


def test_the_same_case_is_made_again() -> None:
    first, again = (make_field_case(case("source", 1)) for _ in range(2))
    np.testing.assert_array_equal(first.readings, again.readings)
    assert first.truth.period is not None


@pytest.mark.parametrize("system", ["fisher", "swift_hohenberg"])
def test_the_hidden_term_is_what_the_simulator_lacks(system: str) -> None:
    made = make_field_case(case("term", system=system))
    simulator, states = system_of(made.system), torch.from_numpy(made.truth.states)
    [term] = made.truth.terms
    found = simulator.evaluate(term.term, states).numpy()
    error = np.sqrt(np.mean((found - made.truth.hidden[:, 0]) ** 2))
    assert error < 0.01 * np.sqrt(np.mean(found**2))


@pytest.mark.parametrize("system", ["fisher", "swift_hohenberg"])
def test_with_nothing_hidden_truth_and_simulator_agree(system: str) -> None:
    """Their operators are different ones: finite differences here, spectral there."""
    made = make_field_case(case("nothing", system=system))
    states, times = torch.from_numpy(made.truth.states), torch.from_numpy(made.truth.times)
    own = simulate(system_of(made.system), states[:1], times)[0]
    assert float((own - states).square().mean().sqrt()) < 0.005 * float(states.std())
    assert not made.truth.hidden.any() and made.truth.says == "nothing"


@pytest.mark.parametrize("kind", ["source", "region"])
def test_what_is_local_lies_in_its_region(kind: Kind) -> None:
    truth = make_field_case(case(kind)).truth
    assert truth.region is not None
    strength = np.abs(truth.hidden[:, 0]).max(axis=0)
    places = np.arange(len(strength)) * 12 / len(strength)
    inside = (places - truth.region[0]) % 12 <= (truth.region[1] - truth.region[0]) % 12
    assert inside[strength.argmax()] and strength[inside].sum() > 0.9 * strength.sum()


def test_a_fitted_sensor_errs_and_no_other() -> None:
    made, right = make_field_case(case("sensor")), make_field_case(case("nothing"))
    names = [sensor.name for sensor in made.sensors]
    erring = names.index(str(made.truth.sensor))
    fitted = fitted_sensors(made.sensors, made.truth.times, case("sensor").analysis_seed)
    assert erring in fitted
    assert right.truth.sensor is None and not made.truth.hidden.any()
