"""Cases of polynomial systems, with a stand-in for the collection."""

from __future__ import annotations

import sys
from types import ModuleType
from typing import Any, ClassVar

import numpy as np
import pytest
import torch

from dashred.evaluation.foreign.cases import dysts_cases
from dashred.evaluation.foreign.cases.case import Case, MadeCase
from dashred.evaluation.foreign.cases.dysts_systems import PolynomialSystem, polynomial_systems
from tests.evaluation.foreign.invented import system_of

LORENZ = PolynomialSystem(
    "Lorenz",
    (
        {(0,): -10.0, (1,): 10.0},
        {(0,): 28.0, (1,): -1.0, (0, 2): -1.0},
        {(2,): -2.667, (0, 1): 1.0},
    ),
    (-9.8, -15.0, 20.5),
    1.5,
)


def made(monkeypatch: pytest.MonkeyPatch, number: int) -> MadeCase:
    monkeypatch.setattr(dysts_cases, "polynomial_systems", lambda: {"Lorenz": LORENZ})
    return dysts_cases.make_dysts_case(Case("dysts", "Lorenz", "term", number, 0.02, 3))


def test_the_same_case_is_made_again(monkeypatch) -> None:
    first, again, other = (made(monkeypatch, number) for number in (0, 0, 1))
    np.testing.assert_array_equal(first.readings, again.readings)
    assert first.system == again.system and first.truth.says == again.truth.says
    assert not np.array_equal(first.truth.states, other.truth.states)


@pytest.mark.parametrize("number", range(2))
def test_simulator_and_hidden_term_are_the_truth(monkeypatch, number: int) -> None:
    case = made(monkeypatch, number)
    system, states = system_of(case.system), case.truth.states
    simulated = [
        system.evaluate(str(case.system["equations"][name]), torch.from_numpy(states)).numpy()
        for name in "xyz"
    ]
    total = np.stack(simulated, axis=1) + case.truth.hidden
    np.testing.assert_allclose(total, LORENZ.tendency(states), rtol=1e-9, atol=1e-9)
    [term] = case.truth.terms
    hidden = system.evaluate(term.term, torch.from_numpy(states)).numpy() * term.coefficient
    column = "xyz".index(term.equation)
    np.testing.assert_allclose(hidden, case.truth.hidden[:, column], rtol=1e-9)
    others = np.delete(case.truth.hidden, column, axis=1)
    assert not others.any()


def test_record_noise_and_start_are_as_promised(monkeypatch) -> None:
    case = made(monkeypatch, 0)
    truth = case.truth
    assert len(truth.times) == 320 and truth.times[-1] == pytest.approx(15.0)
    columns = ["xyz".index(sensor.field) for sensor in case.sensors]
    error = (case.readings - truth.states[:, columns]) / truth.states.std(axis=0)[columns]
    assert error.std() == pytest.approx(0.02, rel=0.1)
    off = [case.system["start"][n] - truth.states[0, i] for i, n in enumerate("xyz")]
    assert 0 < np.abs(off / truth.states.std(axis=0)).max() < 0.5
    assert case.system["spread"]["x"] == pytest.approx(0.1 * truth.states[:, 0].std(), rel=1e-3)


def test_a_simulator_is_written_as_one_would() -> None:
    assert dysts_cases.simulator_equations(LORENZ, [(2, (0, 1))]) == {
        "x": "-10*x + 10*y",
        "y": "28*x - y - x*z",
        "z": "-2.667*z",
    }
    alone = PolynomialSystem("alone", ({(): -1.0}, {(): 2.0, (0,): 1.0}), (1, 1), 1.0)
    assert dysts_cases.simulator_equations(alone, [(0, ())]) == {"x": "0", "y": "2 + x"}


def test_half_of_the_cases_do_not_measure_one_variable() -> None:
    left_out, rng = dysts_cases.LeftOut(2, (0, 1), 1.0, 1.0), np.random.default_rng(0)
    counts = [len(dysts_cases._measured(LORENZ, left_out, rng)) for _ in range(200)]
    assert set(counts) == {2, 3} and 80 <= counts.count(2) <= 120


def test_a_variable_without_effect_is_always_measured() -> None:
    alone = PolynomialSystem("alone", ({(0,): -1.0}, {(0,): 1.0}, {(1,): 1.0}), (1, 1, 1), 1.0)
    left_out = dysts_cases.LeftOut(2, (1,), 1.0, 1.0)
    measured = {dysts_cases._measured(alone, left_out, np.random.default_rng(i)) for i in range(9)}
    assert measured == {"xyz", "yz"}


class _Base:
    """Stand-in for ``DynSys``."""

    ic: ClassVar[Any] = np.array([0.1, 0.2, 0.3])
    period: ClassVar[Any] = 2.0
    param_list: ClassVar[list[float]] = [0.5]

    def rhs(self, state: Any, t: float) -> Any:
        return type(self)._rhs(*state, t, *self.param_list)  # type: ignore[attr-defined]


class Cubic(_Base):
    """Polynomial and autonomous."""

    _rhs = staticmethod(lambda x, y, z, t, a: (a * y, x - z**3, -z))


class Driven(_Base):
    """Depends on time."""

    _rhs = staticmethod(lambda x, y, z, t, a: (a * y + t, x, -z))


class Sine(_Base):
    """Is no polynomial."""

    _rhs = staticmethod(lambda x, y, z, t, a: (np.sin(y), x, -z))


class Plane(_Base):
    """Has two variables."""

    ic: ClassVar[Any] = np.array([0.1, 0.2])
    _rhs = staticmethod(lambda x, y, t, a: (y, -x))


def test_only_autonomous_polynomials_of_the_collection_are_read(monkeypatch) -> None:
    package, flows, base = map(ModuleType, ("dysts", "dysts.flows", "dysts.base"))
    package.__spec__ = sys.__spec__  # found, as an installed package is
    base.DynSys = _Base  # type: ignore[attr-defined]
    for kind in (Cubic, Driven, Sine, Plane):
        monkeypatch.setattr(kind, "__module__", "dysts.flows")
        setattr(flows, kind.__name__, kind)
    for module in (package, flows, base):
        monkeypatch.setitem(sys.modules, module.__name__, module)
    polynomial_systems.cache_clear()
    try:
        [cubic] = polynomial_systems().values()
    finally:
        polynomial_systems.cache_clear()
    assert cubic.name == "Cubic" and cubic.period == 2.0
    assert cubic.equations == ({(1,): 0.5}, {(0,): 1.0, (2, 2, 2): -1.0}, {(2,): -1.0})
