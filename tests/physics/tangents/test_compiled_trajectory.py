"""The compiled reference trajectory against the interpreted one."""

from __future__ import annotations

import pytest
import torch

from dashred.physics.forcing_basis import SampledForcing
from dashred.physics.runs.initial_state_prior import nominal_start
from dashred.physics.solvers.compiled.etdrk4 import CompiledETDRK4
from dashred.physics.solvers.forcing import Forcing
from dashred.physics.system import System, Term
from dashred.physics.tangents.compiled_trajectory import CompiledTrajectory
from dashred.physics.tangents.tangent_linear import tangent_linear
from dashred.physics.terms.library import resolve
from tests.spectral_systems import PLANE, REACTION, TIMES

TEXTS = {
    "reaction": {"u": ["u**3", "d(u, x, 2)"], "v": ["d(u, x)*v"]},
    "plane": {"w": ["w**2", "lap(w**3)"]},
}


def parsed_terms(system: System, texts: dict[str, list[str]]) -> tuple[Term, ...]:
    """Return the terms of each equation."""
    found = [
        Term(equation, system.parse(text, "test", equation=equation))
        for equation, several in texts.items()
        for text in several
    ]
    return resolve(system, found)


@pytest.mark.parametrize("is_forced", [False, True])
@pytest.mark.parametrize(("name", "text"), [("reaction", REACTION), ("plane", PLANE)])
def test_states_and_tangents_are_those_of_the_interpreted_trajectory(
    make_system, name: str, text: str, is_forced: bool
) -> None:
    system = make_system(text)
    terms = parsed_terms(system, TEXTS[name])
    weights = 0.05 * torch.arange(1.0, len(terms) + 1, dtype=torch.float64)[None]
    knots = torch.tensor([0.4, 1.1, 1.8], dtype=torch.float64)
    generator = torch.Generator().manual_seed(1)
    values = 0.1 * torch.randn(
        (1, 3, len(system.fields), *system.grid.shape), generator=generator, dtype=torch.float64
    )
    sampled = SampledForcing(knots, values) if is_forced else None
    start = nominal_start(system)[0]
    arguments = system, start, start[None], TIMES, Forcing(terms, weights), [terms[:1]]
    trajectory = CompiledTrajectory(CompiledETDRK4(system, terms), weights, sampled)
    expected = tangent_linear(*arguments, sampled_forcing=sampled)
    found = tangent_linear(*arguments, sampled_forcing=sampled, reference=trajectory)
    for (state, columns), (same, own) in zip(expected, found, strict=True):
        torch.testing.assert_close(same, state, rtol=1e-11, atol=1e-11)
        torch.testing.assert_close(own, columns, rtol=1e-9, atol=1e-9)
