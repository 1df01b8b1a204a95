"""Ensembles: bounded, repeatable, and with discrepancies of the stated size."""

from __future__ import annotations

import numpy as np
import pytest
import torch

from dashred.core.budget import OutOfTimeError
from dashred.core.errors import InputError
from dashred.physics.runs import members
from dashred.physics.runs.ensemble import Discrepancies, MemberSource, draw_ensemble, term_scales
from dashred.physics.runs.initial_state_prior import StartPrior, nominal_start
from dashred.physics.solvers.forcing import Forcing
from dashred.physics.solvers.simulate import simulate
from dashred.physics.system import Term
from dashred.physics.terms.library import build_library, evaluate_terms, resolve

TIMES = torch.linspace(0, 1, 6, dtype=torch.float64)


def setting(system):
    start = nominal_start(system)
    nominal = simulate(system, start, TIMES)[0]
    rms = nominal.transpose(0, 1).flatten(1).pow(2).mean(1).sqrt()
    return nominal, StartPrior(system, start[0], rms, 8)


def draw(system, seed, members=12, **discrepancy):
    nominal, prior = setting(system)
    random = Discrepancies(build_library(system, None), **discrepancy) if discrepancy else None
    rng = np.random.default_rng(seed)
    return draw_ensemble(MemberSource(system, TIMES, prior, nominal, random, rng), members)


@pytest.mark.parametrize("name", ["reaction", "oscillator"])
def test_the_same_seed_gives_the_same_ensemble(request, name):
    system = request.getfixturevalue(name)
    first, again, other = (draw(system, seed, terms=2, amplitude=0.2) for seed in (3, 3, 4))
    assert torch.equal(first.states, again.states)
    assert torch.equal(first.coefficients, again.coefficients)
    assert not torch.equal(first.states, other.states)


def test_members_carry_the_terms_that_they_name(reaction):
    # Not one of those that antidiffusion lets grow: rounding grows with them.
    members = draw(reaction, 1, terms=3, amplitude=0.2)
    assert members.states.shape == (12, 6, 2, 32)
    assert ((members.coefficients != 0).sum(1) == 3).all()
    library = resolve(reaction, build_library(reaction, None))
    again = simulate(reaction, members.states[:, 0], TIMES, Forcing(library, members.coefficients))
    torch.testing.assert_close(again, members.states, rtol=1e-9, atol=1e-9)
    plain = simulate(reaction, members.states[:, 0], TIMES)
    assert not torch.allclose(plain, members.states, atol=1e-3)


def test_a_plain_ensemble_has_no_terms(reaction):
    members = draw(reaction, 0)
    assert members.coefficients.shape == (12, 0)
    assert len(torch.unique(members.states[:, 0], dim=0)) == 12


def test_members_stay_within_the_nominal_range_and_its_width(reaction):
    nominal, _ = setting(reaction)
    members = draw(reaction, 0, members=30, terms=3, amplitude=2.0)
    low, high = nominal.amin((0, 2)), nominal.amax((0, 2))
    width = high - low
    assert (members.states.amin((0, 1, 3)) >= low - width).all()
    assert (members.states.amax((0, 1, 3)) <= high + width).all()


def test_a_hopeless_ensemble_is_refused(reaction):
    with pytest.raises(
        InputError, match=r"after 3 rounds only \d of 2 simulations stay within bounds"
    ):
        draw(reaction, 0, members=2, terms=10, amplitude=1e6)


# The nominal run decays, and a start beyond about 1.8 grows without limit.
LOSING = """
    fields: {u: place}
    parameters: {}
    equations: {u: u**2 - 1.4*u}
    start: {u: 1}
    spread: {u: 0.6}
    integrator: {dt: 0.1, method: rk4}
"""


def test_when_the_time_is_up_half_of_the_members_are_enough(make_system):
    system = make_system(LOSING)
    nominal, prior = setting(system)

    def drawn(rounds):
        begun = []

        def progress(done):
            begun.extend([done] * (done == 0))
            if len(begun) > rounds:
                raise OutOfTimeError

        rng = np.random.default_rng(5)
        source = MemberSource(system, TIMES, prior, nominal, None, rng, progress)
        return draw_ensemble(source, 64)

    whole, cut = drawn(20), drawn(1)
    assert len(whole.states) == 64 > len(cut.states) >= 32
    torch.testing.assert_close(cut.states, whole.states[: len(cut.states)])
    with pytest.raises(OutOfTimeError):
        drawn(0)


def test_members_that_are_lost_are_replaced_by_compiled_runs(make_system, monkeypatch):
    system = make_system(LOSING)
    nominal, prior = setting(system)
    repeats = []

    def spy(*args, **options):
        repeats.append(options["repeats"])
        return simulate(*args, **options)

    monkeypatch.setattr(members, "simulate", spy)
    rng = np.random.default_rng(5)
    draw_ensemble(MemberSource(system, TIMES, prior, nominal, None, rng), 64)
    assert repeats[0] == 1 and all(count > 1 for count in repeats[1:]) and len(repeats) > 1


def test_all_terms_of_a_small_library_are_drawn(oscillator):
    assert (draw(oscillator, 0, terms=99, amplitude=0.1).coefficients != 0).all()


def test_a_field_at_rest_sets_no_bounds(make_system):
    system = make_system("""
        fields: {u: place, w: at rest}
        parameters: {}
        equations: {u: -u, w: 0*u}
        start: {u: 1, w: 3}
        spread: {u: 0.1, w: 0.5}
        integrator: {dt: 0.1}
    """)
    assert float(draw(system, 0).states[:, 0, 1].std()) > 0.2


def test_a_start_far_outside_of_a_small_nominal_simulation_is_bounded(make_system):
    system = make_system("""
        fields: {u: place, v: speed}
        parameters: {}
        equations: {u: v, v: -u}
        start: {u: 0.01, v: 0}
        spread: {u: 1, v: 1}
        integrator: {dt: 0.1}
    """)
    assert float(draw(system, 0).states[:, 0].std()) == pytest.approx(1.0, rel=0.4)


def test_a_term_of_unit_scale_is_as_large_as_the_tendency(reaction):
    nominal, _ = setting(reaction)
    library = build_library(reaction, None)
    scales = term_scales(reaction, library, nominal, 0.0)
    columns = evaluate_terms(reaction, library, nominal, 0.0).flatten(1)
    tendencies = [Term(f, reaction.equations[f]) for f in reaction.fields]
    rms = evaluate_terms(reaction, tendencies, nominal, 0.0).flatten(1).pow(2).mean(1).sqrt()
    expected = [rms[reaction.fields.index(term.equation)] for term in library]
    scaled = (scales[:, None] * columns).pow(2).mean(1).sqrt()
    torch.testing.assert_close(scaled, torch.stack(expected))


def test_drawn_coefficients_have_the_stated_amplitude(make_system):
    oscillator = make_system("""
        fields: {x: place, p: momentum}
        parameters: {}
        equations: {x: p, p: -x}
        start: {x: 1, p: 0}
        spread: {x: 0.1, p: 0.1}
        integrator: {dt: 0.1, method: rk4}
    """)
    nominal, _ = setting(oscillator)
    library = build_library(oscillator, None)
    members = draw(oscillator, 0, members=200, terms=5, amplitude=0.1)
    scales = term_scales(oscillator, library, nominal, 0.0)
    sizes = (members.coefficients / scales)[members.coefficients != 0]
    assert len(sizes) == 1000
    assert float(sizes.std()) == pytest.approx(0.1, rel=0.08)
