"""Equations of a program that only define another field."""

from __future__ import annotations

import torch

from dashred.physics.runs.initial_state_prior import nominal_start
from dashred.physics.runs.program_definitions import program_definitions
from dashred.physics.runs.tendency_size import program_rates, tendency_size
from dashred.physics.solvers.simulate import simulate

TEXT = """
    fields: {x: place, v: velocity}
    parameters: {k: 4.0}
    simulator: {function: tests.programs.oscillator}
    start: {x: 1.0, v: 0.0}
    integrator: {dt: 0.05}
"""


def test_the_rate_of_a_place_is_its_velocity(make_system) -> None:
    system = make_system(TEXT, "trust=tests.programs.oscillator", "recording.path=recorded.csv")
    times = torch.linspace(0, 10, 101, dtype=torch.float64)
    [path] = simulate(system, nominal_start(system), times)
    # v' = -k x is a force: the factor is negative.
    assert program_definitions(system, path, times) == {"x": "v"}
    rates = program_rates(system, path, times)
    torch.testing.assert_close(rates[:, 0], path[:, 1], rtol=0, atol=0.01)
    sizes = tendency_size(system, path, times)
    torch.testing.assert_close(sizes[1], (4 * path[:, 0]).square().mean().sqrt(), rtol=0.01, atol=0)


def test_a_momentum_is_a_rate_and_a_substrate_is_not(make_system) -> None:
    words = "recording.path=recorded.csv"
    times = torch.linspace(0, 10, 101, dtype=torch.float64)
    text = TEXT.replace("oscillator", "heavy").replace("k: 4.0", "k: 4.0, m: 3.0")
    text = text.replace("v: velocity", "p: momentum").replace("v: 0.0", "p: 0.0")
    system = make_system(text, "trust=tests.programs.heavy", words)
    [path] = simulate(system, nominal_start(system), times)
    assert program_definitions(system, path, times) == {"x": "p"}
    system = make_system(
        """
        fields: {a: substrate, b: product}
        parameters: {k: 0.4}
        simulator: {function: tests.programs.chain}
        start: {a: 1.0, b: 0.0}
        integrator: {dt: 0.05}
        """,
        "trust=tests.programs.chain",
        words,
    )
    [path] = simulate(system, nominal_start(system), times)
    assert program_definitions(system, path, times) == {}
