"""The members of an ensemble are the same, bit for bit, wherever they are simulated."""

from __future__ import annotations

import pytest
import torch
from torch import Tensor

from dashred.core.cluster.calls import ClusterCalls
from dashred.core.work import work_done
from dashred.physics.runs import members as module
from dashred.physics.runs.initial_state_prior import nominal_start
from dashred.physics.solvers.forcing import Forcing
from dashred.physics.solvers.simulate import simulate
from dashred.physics.system import System, Term
from dashred.physics.terms.library import resolve

TIMES = torch.linspace(0, 1, 6, dtype=torch.float64)
MEMBERS = 7
# Many rounds are worth a compilation.
ROUNDS = 1e6
NESTED = """
    axes: {x: {length: 2*pi, points: 32}}
    fields: {u: height}
    equations: {u: 0.01*u*lap(u**2) - u}
    start: {u: 1 + 0.2*sin(x)}
    integrator: {dt: 0.05}
"""


@pytest.fixture(params=[1, 2, 3])
def calls(request: pytest.FixtureRequest, two_workers: ClusterCalls) -> ClusterCalls:
    """So many calls at once."""
    return ClusterCalls(two_workers._client, request.param)


def drawn(system: System, texts: tuple[tuple[str, str], ...]) -> tuple[Tensor, Forcing]:
    """Return random starts, and coefficients of which each member has some."""
    generator = torch.Generator().manual_seed(2)
    [start] = nominal_start(system)
    starts = start * (1 + 0.1 * torch.randn((MEMBERS, 1, 1), generator=generator).double())
    library = [Term(e, system.parse(text, "library", equation=e)) for e, text in texts]
    coefficients = 0.1 * torch.randn((MEMBERS, len(library)), generator=generator).double()
    coefficients[::2, ::2] = 0
    return starts, Forcing(resolve(system, library), coefficients)


def test_workers_return_the_bits_of_this_machine(reaction, calls, monkeypatch) -> None:
    terms = (("u", "u**2"), ("u", "lap(u)"), ("v", "u*v"), ("v", "d(u, x)"), ("v", "v"))
    starts, forcing = drawn(reaction, terms)
    before = work_done()
    expected = module.simulate_members(reaction, starts, TIMES, forcing, rounds=ROUNDS)
    between = work_done()
    monkeypatch.setattr(module, "WORTHWHILE", 0)
    monkeypatch.setattr(module, "cluster_in_use", lambda: calls)
    done: list[float] = []
    found = module.simulate_members(reaction, starts, TIMES, forcing, done.append)
    assert torch.equal(found, expected)
    assert done[-1] == 1.0 and len(done) == calls.count
    there, here = (
        late["trajectory values"] - early["trajectory values"]
        for early, late in ((between, work_done()), (before, between))
    )
    assert there == here > 0


def test_equations_that_are_not_compiled_run_here(make_system, two_workers, monkeypatch) -> None:
    system = make_system(NESTED)
    starts, forcing = drawn(system, (("u", "u**2"),))
    monkeypatch.setattr(module, "WORTHWHILE", 0)
    monkeypatch.setattr(module, "cluster_in_use", lambda: two_workers)
    found = module.simulate_members(system, starts, TIMES, forcing)
    assert torch.equal(found, simulate(system, starts, TIMES, forcing))


def test_only_large_ensembles_of_spectral_fields_are_sent(reaction, oscillator) -> None:
    starts, forcing = drawn(reaction, (("u", "u**2"),))
    assert not module.is_large(reaction, starts, TIMES, forcing)
    long = torch.linspace(0, 1e5, 6, dtype=torch.float64)
    assert module.is_large(reaction, starts, long, forcing)
    assert not module.is_large(reaction, starts[:1], long, forcing)
    begin = nominal_start(oscillator).expand(MEMBERS, -1)
    nothing = Forcing((), torch.zeros((MEMBERS, 0)))
    assert not module.is_large(oscillator, begin, long, nothing)
