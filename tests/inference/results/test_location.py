"""Location: shares, regimes, times and sensors of laws with a known location."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
import torch
from torch import Tensor

from dashred.core.findings.law_schema import Where
from dashred.inference.fit.law import Law
from dashred.inference.hypotheses.result import Discovery
from dashred.inference.results.location import (
    LONGEST_PROFILE,
    _profile,
    law_tendency,
    locate,
)
from dashred.inference.results.regime import active_states
from dashred.physics.system import System, Term
from dashred.physics.terms.library import evaluate_terms
from dashred.reporting.text.regions import states_text
from tests import laws

TIMES = 0.1 * torch.arange(laws.SAMPLES, dtype=torch.float64)
NAMES = ["a", "b", "c"]


@pytest.fixture(scope="module")
def flow(tmp_path_factory: pytest.TempPathFactory) -> System:
    return laws.declared(tmp_path_factory.mktemp("flow"))


def bump(system: System) -> Tensor:
    """A narrow travelling pulse of u on a background of 1; lam is smooth."""
    x = system.grid.coordinates["x"]
    shift = (x - TIMES[:, None] - torch.pi).remainder(2 * torch.pi) - torch.pi
    u = 1 + torch.exp(-((shift / 0.4) ** 2))
    return torch.stack([u, 0.5 + 0.1 * torch.cos(shift)], dim=1)


def found(system: System, discovery: Discovery) -> Where:
    return locate(system, discovery, bump(system), TIMES, NAMES, discovery.noise.std)


def rms(system: System, equation: str, states: Tensor) -> float:
    own = [Term(equation, system.equations[equation])]
    return float(evaluate_terms(system, own, states, 0.0).square().mean().sqrt())


def test_equation_shares_are_rms_relative_to_each_equations_own(flow: System) -> None:
    states = bump(flow)
    law = laws.law([laws.term(flow, "u", "u"), laws.term(flow, "lam", "1")], [-0.04, 0.01])
    u = 0.04 * float(states[:, 0].square().mean().sqrt()) / rms(flow, "u", states)
    lam = 0.01 / rms(flow, "lam", states)
    where = found(flow, laws.discovery(law))
    assert where["equation"] == pytest.approx({"u": u / (u + lam), "lam": lam / (u + lam)})
    alone = found(flow, laws.discovery(laws.law(law.candidates[:1], [-0.04])))
    assert alone["equation"] == {"u": 1.0, "lam": 0.0}


def test_a_parameter_has_its_share_in_every_equation_it_enters(flow: System) -> None:
    law = laws.law([laws.parameter(flow, "nu")], [0.02])
    shares = found(flow, laws.discovery(law))["equation"]
    assert min(shares.values()) > 0.01 and sum(shares.values()) == pytest.approx(1.0)


def test_time_dependent_terms_are_evaluated_at_their_times(flow: System) -> None:
    states = bump(flow)
    law = laws.law([laws.term(flow, "u", "t*u")], [1.0])
    size = law_tendency(flow, law, states, TIMES)[:, 0] * rms(flow, "u", states)
    torch.testing.assert_close(size, TIMES[:, None] * states[:, 0])


@pytest.mark.parametrize(
    ("term", "acts"), [("(u - 1)**3", "u > "), ("(u - 2)**2", None), ("u", None)]
)
def test_a_regime_is_given_only_for_a_local_law(flow: System, term: str, acts: str | None) -> None:
    where = found(flow, laws.discovery(laws.law([laws.term(flow, "u", term)], [0.1])))
    states = where["states"]
    if acts is None:
        assert states is None
        return
    assert states is not None and not states["magnitude"]
    text = states_text(states, {}, in_space=True)
    assert text.startswith(acts)
    threshold = states["above"]
    power = (bump(flow)[:, 0] - 1) ** 6
    inside = bump(flow)[:, 0] >= threshold
    assert float(power[inside].sum() / power.sum()) == pytest.approx(0.8, abs=0.05)
    share = float(inside.double().mean())
    assert f"({share:.0%} of space and time".replace("%", " %") in text


def test_a_regime_of_both_signs_is_a_regime_of_the_magnitude(
    tmp_path_factory: pytest.TempPathFactory,
) -> None:
    system = laws.declared(tmp_path_factory.mktemp("pendulum"), laws.PENDULUM)
    phase = torch.linspace(0, 20, 400, dtype=torch.float64)
    states = torch.stack([torch.sin(phase), torch.cos(phase)], dim=1)
    found = active_states(system, states, torch.cos(phase) ** 10, ["omega"])
    assert found is not None
    text = states_text(found, {}, in_space=False)
    assert text.startswith("|omega| > ") and "of the time" in text
    # The same states, by the field that the law depends on.
    found = active_states(system, states, torch.cos(phase) ** 10, ["theta"])
    assert found is not None
    assert states_text(found, {}, in_space=False).startswith("|theta| < ")
    assert active_states(system, states, torch.zeros(400), []) is None


def law_with_residuals(first: float, then: float) -> Law:
    """A law of one term whose residuals differ from 1 only at the first sensor."""
    law = laws.law([], [])
    law.residuals[:, 0] = first
    law.residuals[20:, 0] = then
    return law


def test_a_law_has_a_gain_where_the_misfit_decreases(flow: System) -> None:
    best = laws.law([laws.term(flow, "u", "u")], [0.1])
    where = found(flow, laws.discovery(best, uncorrected=law_with_residuals(3.0, 3.0)))
    first, second, _ = where["sensors"]
    assert first["name"] == "a" and first["gain"] == pytest.approx(8.0)
    assert first["before"] == pytest.approx(9.0) and first["after"] == pytest.approx(1.0)
    assert first["p"] is not None and first["p"] < 1e-12
    assert second["gain"] == pytest.approx(0.0) and second["p"] == pytest.approx(1.0)


def test_misfits_are_in_units_of_the_noise_of_the_traces(flow: System) -> None:
    # The residuals of the fit, of σ = 1, are four times the noise.
    best = laws.law([laws.term(flow, "u", "u")], [0.1])
    discovery = laws.discovery(best, uncorrected=law_with_residuals(3.0, 3.0))
    recorded = discovery.noise.std / 4
    where = locate(flow, discovery, bump(flow), TIMES, NAMES, recorded)
    first, second, _ = where["sensors"]
    assert first["before"] == pytest.approx(144.0) and first["after"] == pytest.approx(16.0)
    assert where["profile"]["after"] == pytest.approx([4.0] * len(TIMES))
    # The tests are those of the fit.
    old = found(flow, discovery)
    assert where["significance"] == old["significance"]
    assert [each["p"] for each in where["sensors"]] == [each["p"] for each in old["sensors"]]
    assert second["p"] == pytest.approx(1.0)


def test_the_profile_in_time(flow: System) -> None:
    best = laws.law([laws.term(flow, "u", "u")], [0.1])
    available = torch.ones(laws.SAMPLES, laws.SENSORS, dtype=torch.bool)
    available[5] = False
    discovery = laws.discovery(best, uncorrected=law_with_residuals(1.0, 4.0), seen=available)
    profile = found(flow, discovery)["profile"]
    assert profile["times"] == pytest.approx(TIMES.tolist())
    assert profile["before"][4] == pytest.approx(1.0) and profile["before"][5] is None
    assert profile["before"][30] == pytest.approx(((16 + 1 + 1) / 3) ** 0.5)


def test_significance_is_corrected_for_the_search(flow: System) -> None:
    u = laws.term(flow, "u", "u")
    # χ² falls from 120·1.1² to 120, by 25.2: p of one coefficient 5.2e-7, fifty tries.
    close = laws.discovery(laws.law([u], [0.1]), uncorrected=laws.law(misfit=1.1))
    assert found(flow, close)["significance"] == pytest.approx(50 * 5.18e-7, rel=0.01)
    useless = laws.discovery(laws.law([u], [0.1]), uncorrected=laws.law(misfit=1.0))
    assert found(flow, useless)["significance"] == 1.0


def test_omitted_samples_do_not_change_the_significance(flow: System) -> None:
    law = laws.law([laws.term(flow, "u", "u")], [0.1])
    residuals = law.residuals.clone()
    residuals[3:5, 0] = torch.nan
    where = found(flow, laws.discovery(replace(law, residuals=residuals)))
    assert where["significance"] is not None and where["significance"] < 1e-6
    assert all(sensor["gain"] is not None and sensor["gain"] > 0 for sensor in where["sensors"])


def test_an_empty_law_acts_nowhere(flow: System) -> None:
    where = found(flow, laws.discovery(laws.law(), uncorrected=laws.law()))
    assert where["equation"] == {"u": 0.0, "lam": 0.0}
    assert where["states"] is None and where["significance"] is None
    assert where["time"] == pytest.approx([0.0, 3.9])


def test_a_long_profile_has_groups_of_one_size() -> None:
    count = 2 * LONGEST_PROFILE - 79
    readings, seen = torch.ones(count, 2), torch.ones(count, 2, dtype=torch.bool)
    profile = _profile(torch.arange(float(count)), 3 * readings, readings, seen)
    steps = np.diff(profile["times"])
    assert len(profile["times"]) == (count + 1) // 2
    np.testing.assert_allclose(steps[:-1], 2)
    assert profile["before"] == pytest.approx([3.0] * len(profile["times"]))
