"""Uncertain parameters in the forward model: readings, derivatives and fits, of ODEs and fields."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import pytest
import torch

from dashred.data.observation_operator import ObservationOperator
from dashred.data.sensors import Sensor
from dashred.inference.fit.fitted_law import build_law
from dashred.inference.fit.least_squares import LeastSquaresProblem
from dashred.inference.fit.levenberg_marquardt import minimise
from dashred.inference.fit.noise_model import NoiseModel
from dashred.inference.forward.candidate_simulator import CandidateSimulator
from dashred.inference.forward.candidates import Candidate, ChangePrior, build_candidates
from dashred.inference.forward.episodes import EpisodeStarts, stack_times
from dashred.inference.forward.forward_model import ForwardModel
from dashred.inference.forward.law_block import LawBlock
from dashred.inference.forward.parameter_block import split_parameters
from dashred.inference.forward.sensor_block import SensorBlock
from dashred.inference.forward.simulator import Simulator
from dashred.inference.results.corrected_system import build_corrected_system, with_parameters
from dashred.physics.runs.initial_state_prior import StartPrior, field_rms, nominal_start
from dashred.physics.solvers.simulate import simulate
from dashred.physics.system import System, Term
from tests import laws

SPRING = """
system:
  title: a spring
  fields: {q: place, p: momentum}
  parameters: {k: 2.0, b: 0.1, m: 1.0}
  equations: {q: p, p: -k*q/m - b*p}
  start: {q: 1, p: 0}
  spread: {q: 0.1, p: 0.1}
  integrator: {method: rk4, dt: 0.05}
recording: {twin: a, sensors: 1, noise: 0, duration: 4, every: 0.1}
"""
SPREADING = """
system:
  title: spreading in a wind
  axes: {x: {length: 2*pi, points: 16}}
  fields: {u: amount}
  parameters: {nu: 0.1, c: 0.5}
  equations: {u: nu*lap(u) - c*d(u, x)}
  start: {u: cos(x) + 0.5*sin(2*x)}
  spread: {u: 0.2, length: 3}
  integrator: {dt: 0.05}
recording: {twin: a, sensors: 2, noise: 0, duration: 4, every: 0.1}
"""
TIMES = 0.2 * torch.arange(21, dtype=torch.float64)
PRIOR = ChangePrior(0.05, 0.2)
CASES = {
    "ODE": (SPRING, "k", ("p", "q**3"), (Sensor("q", "q"), Sensor("p", "p"))),
    "field": (
        SPREADING,
        "nu",
        ("u", "u**3"),
        (Sensor("a", "u", (1.0,)), Sensor("b", "u", (3.0,))),
    ),
}


@pytest.fixture(params=CASES)
def model(request: pytest.FixtureRequest, tmp_path: Path) -> ForwardModel:
    """A forward model with one uncertain parameter and one term."""
    text, name, (equation, term), sensors = CASES[request.param]
    system = laws.declared(tmp_path, text)
    uncertain = replace(laws.parameter(system, name), prior=PRIOR)
    parameters, _ = split_parameters([uncertain])
    candidates = [laws.term(system, equation, term)]
    part = CandidateSimulator(system, system.dt, [uncertain, *candidates])
    start = nominal_start(system)[0]
    rms = field_rms(simulate(system, start[None], TIMES)[0])
    return ForwardModel(
        Simulator([part], parameters),
        EpisodeStarts((StartPrior(system, start, rms, 4),)),
        LawBlock(candidates),
        SensorBlock(ObservationOperator(sensors, system)),
        stack_times([TIMES]),
    )


def unknowns(model: ForwardModel, change: float) -> torch.Tensor:
    """Return the z of the nominal start and a change of the parameter."""
    z = torch.zeros(model.modes, dtype=torch.float64)
    z[-1] = (change - PRIOR.mean) / PRIOR.std
    return z


def changed_system(model: ForwardModel, change: float) -> System:
    system, [found] = model.simulator.system, model.simulator.parameters.candidates
    return with_parameters(system, {found.name: system.config.parameters[found.name] + change})


def test_a_change_of_a_parameter_that_acts_linearly_is_exact(model: ForwardModel) -> None:
    change = 0.03
    states = model.states(unknowns(model, change)[None], torch.zeros((1, 1)).double())[0, :, 0]
    own = simulate(changed_system(model, change), states[:1], TIMES)[0]
    torch.testing.assert_close(states, own, rtol=1e-6, atol=1e-7)


def test_the_derivative_by_a_parameter(model: ForwardModel) -> None:
    z, xi = unknowns(model, 0.03), torch.tensor([0.02], dtype=torch.float64)
    found = model.linearise(z, xi)
    step = torch.zeros_like(z)
    step[-1] = 1e-4
    ahead, behind = model.readings(torch.stack([z + step, z - step]), xi.repeat(2, 1))
    difference = (ahead - behind) / 2e-4
    assert found.by_start.shape[-1] == model.modes
    size = float(difference.abs().max())
    torch.testing.assert_close(
        found.by_start[..., -1].double(), difference, rtol=0.02, atol=0.02 * size
    )
    # Another start model keeps the parameter.
    other = EpisodeStarts(model.start.models)  # type: ignore[attr-defined]
    assert float(model.move_to(other, z)[-1]) == float(z[-1])


def test_a_fit_recovers_the_parameter_beside_a_term(model: ForwardModel) -> None:
    sigma, change, xi = 0.01, 0.06, torch.tensor([-0.05], dtype=torch.float64)
    [clean] = model.readings(unknowns(model, change)[None], xi[None])
    noise = sigma * torch.randn(clean.shape, generator=torch.Generator().manual_seed(1))
    recorded = clean + noise
    seen = torch.ones(clean.shape, dtype=torch.bool)
    std = torch.full((clean.shape[1],), sigma, dtype=torch.float64)
    problem = LeastSquaresProblem(
        model, recorded, NoiseModel(std, torch.zeros_like(std), seen), torch.ones(1).double()
    )
    fitted = minimise(problem, torch.zeros(problem.modes + 1).double(), 20, 1e-8)
    law = build_law(problem, fitted, fitted.cost)
    [found] = law.parameters
    assert abs(found.change - change) < 3 * found.std < PRIOR.std
    low, high = law.interval(0)
    assert low < -0.05 < high and len(law.candidates) == 1
    corrected = build_corrected_system(model.simulator.system, law)
    name = found.candidate.name
    before = model.simulator.system.config.parameters[name]
    assert corrected.config.parameters[name] == pytest.approx(before + found.change)


def test_collinear_terms_and_parameters_give_way_to_an_uncertain_one(tmp_path: Path) -> None:
    system = laws.declared(tmp_path, SPRING)
    states = simulate(system, nominal_start(system), TIMES)[0]
    library = [Term("p", system.parse(text, "library", equation="p")) for text in ("q", "q**3")]
    found = build_candidates(system, library, states, 0.0, priors={"m": PRIOR})
    parameters, others = split_parameters(found)
    [uncertain] = parameters.candidates
    assert (uncertain.name, uncertain.prior, uncertain.aliases) == ("m", PRIOR, ("k",))
    assert [str(candidate) for candidate in others] == ["parameter b", "p: q**3"]
    assert _names(build_candidates(system, library, states, 0.0)) == ["k", "b", "q**3"]


def test_uncertain_parameters_remain_whatever_the_simulation_shows(tmp_path: Path) -> None:
    """Both of a collinear pair, and one that has no effect on the simulation as it is."""
    text = SPRING.replace("m: 1.0}", "m: 1.0, lim: 9.0}").replace("- b*p", "- b*clip(p, -lim, lim)")
    system = laws.declared(tmp_path, text)
    states = simulate(system, nominal_start(system), TIMES)[0]
    priors = dict.fromkeys(("k", "m", "lim"), PRIOR)
    parameters, others = split_parameters(build_candidates(system, [], states, 0.0, priors=priors))
    assert {c.name for c in parameters.candidates} == {"k", "m", "lim"}
    assert _names(others) == ["b"]


def _names(candidates: list[Candidate]) -> list[str]:
    return [candidate.name for candidate in candidates]
