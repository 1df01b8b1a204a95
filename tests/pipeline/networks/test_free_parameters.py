"""Parameters that are unknowns of an assimilation with dynamics."""

from __future__ import annotations

from dashred.physics.system import Term
from dashred.pipeline.networks.free_parameters import free_parameters
from tests.pipeline.networks.conftest import Configured


def test_they_are_those_whose_effect_no_term_has(configured: Configured) -> None:
    runs = configured()
    [found] = free_parameters(runs.problem, runs.nominal)
    assert found.name == "nu" and found.prior is None and 0 < found.scale < 10
    assert [term.equation for term in found.terms] == ["u"]
    diffusion = Term("u", runs.problem.system.parse("lap(u)", "test", equation="u"))
    wider = runs.problem.with_library([*runs.problem.library, diffusion])
    assert free_parameters(wider, runs.nominal) == []
