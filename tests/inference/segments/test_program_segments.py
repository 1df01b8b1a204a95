"""Segments of a program with a law, against those of the same equations."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pytest
import torch

from dashred.config import load_config
from dashred.inference.forward.candidates import Candidate, build_candidates
from dashred.inference.results.parameter_change import exact_change
from dashred.inference.segments.segments import cut
from dashred.inference.segments.steps.segment_simulator import SegmentSimulator
from dashred.physics.runs.tendency_size import program_slopes, tendency_size
from dashred.physics.solvers.simulate import simulate
from dashred.physics.system import System, Term
from dashred.physics.terms.library import resolve

TEXT = """
system:
  title: pendulum
  fields: {theta: angle, omega: rate}
  parameters: PARAMETERS
  BODY
  start: {theta: 1.2, omega: 0.3}
  integrator: {dt: 0.0125}
recording: {twin: a, sensors: 1, noise: 0, duration: 4, every: 0.1}
"""


def simulator(
    folder: Path, body: str, *words: str, parameters: str = "{g: 4.0}"
) -> SegmentSimulator:
    path = folder / "pendulum.yaml"
    path.write_text(TEXT.replace("BODY", body).replace("PARAMETERS", parameters))
    config = load_config([f"conf={path}", *words], entry="test")
    times = np.linspace(0, 2, 21)
    segments = cut([times], [np.zeros((21, 1))], 4)
    return SegmentSimulator([System(config.system, config.where)], segments, 8)


def both(folder: Path) -> tuple[SegmentSimulator, SegmentSimulator]:
    """Return a pendulum by its equations, and as a program."""
    known = simulator(folder, "equations: {theta: omega, omega: -g*sin(theta)}")
    program = simulator(
        folder,
        "simulator: {function: tests.programs.pendulum}",
        "trust=tests.programs.pendulum",
        "recording.path=recorded.csv",
    )
    return known, program


def candidates(system: System, *listed: tuple[str, str]) -> list[Candidate]:
    terms = [Term(e, system.parse(t, "test", equation=e)) for e, t in listed]
    ready = resolve(system, terms)
    return [Candidate(str(t), t.equation, (r,), 1.0) for t, r in zip(terms, ready, strict=True)]


def test_states_columns_and_rates_are_those_of_the_equations(tmp_path: Path) -> None:
    known, program = both(tmp_path)
    nodes = torch.randn((5, 2), generator=torch.Generator().manual_seed(1)).double().numpy()
    law = candidates(known.systems[0], ("omega", "omega"), ("theta", "1"), ("omega", "theta**3"))
    xi, force = np.array([-0.3, 0.0, 0.1]), np.full((5, 2), 0.05)
    expected, slopes = known.linearise(nodes, law, xi, force, [1])
    found, columns = program.linearise(nodes, law, xi, force, [1])
    np.testing.assert_allclose(found, expected, rtol=0, atol=1e-4)
    np.testing.assert_allclose(columns, slopes, rtol=0, atol=1e-3 * np.abs(slopes).max())
    np.testing.assert_allclose(program.run(nodes, law, xi, force), found, rtol=1e-12, atol=1e-12)
    rates, *_ = program.tendencies(nodes, law)
    np.testing.assert_allclose(rates, known.tendencies(nodes, law)[0], rtol=0, atol=0.03)


def test_a_parameter_of_the_program_has_the_effect_of_that_of_the_equations(tmp_path: Path) -> None:
    known, program = both(tmp_path)
    nodes = torch.randn((5, 2), generator=torch.Generator().manual_seed(1)).double().numpy()
    damping, tangent = candidates(known.systems[0], ("omega", "omega"), ("omega", "-sin(theta)"))
    g = Candidate("g", None, (), 1.0, in_program=True)
    xi = np.array([-0.3, 0.5])
    expected, slopes = known.linearise(nodes, [damping, tangent], xi)
    found, columns = program.linearise(nodes, [damping, g], xi)
    np.testing.assert_allclose(found, expected, rtol=0, atol=1e-4)
    np.testing.assert_allclose(columns, slopes, rtol=0, atol=1e-3 * np.abs(slopes).max())
    np.testing.assert_allclose(program.run(nodes, [damping, g], xi), found, rtol=1e-12, atol=1e-12)
    for simulated, other in ((known, tangent), (program, g)):
        _, terms, equations, owners = simulated.tendencies(nodes, [damping, other])
        total = np.zeros((2, 5))
        np.add.at(total, equations, xi[owners, None] * terms)
        rates = -0.3 * nodes[:, 1] - 0.5 * np.sin(nodes[:, 0])
        np.testing.assert_allclose(total[1], rates, rtol=0, atol=0.02)


def test_parameters_that_a_program_reads_are_candidates(tmp_path: Path) -> None:
    [system] = simulator(
        tmp_path,
        "simulator: {function: tests.programs.pendulum}",
        "trust=tests.programs.pendulum",
        "recording.path=recorded.csv",
        parameters="{g: 4.0, unread: 2}",
    ).systems
    library = resolve(
        system,
        [
            Term("omega", system.parse(text, "test", equation="omega"))
            for text in ("omega", "sin(theta)")
        ],
    )
    states = torch.randn((30, 2), generator=torch.Generator().manual_seed(1)).double()
    found = build_candidates(system, library, states, 0.0)
    assert [str(each) for each in found] == ["parameter g", "omega: omega"]
    # As for equations, a term with the same effect is no candidate.
    assert found[0].in_program and found[0].replaces == ("omega: sin(theta)",)
    # A run has the changed value: nothing is of first order only.
    assert exact_change(system, "g", 0.4) == 0.4
    tendency = tendency_size(system, states, 0.0)[1]
    expected = float(tendency / torch.sin(states[:, 0]).square().mean().sqrt())
    assert 0.5 * expected < found[0].scale < 2 * expected


def test_candidates_take_few_steps_and_have_the_sizes_of_the_equations(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    body = "simulator: {function: tests.programs.pendulum}"
    words = "trust=tests.programs.pendulum", "recording.path=recorded.csv"
    numbers = "{g: 4.0, unread: 2, other: 3}"
    [program] = simulator(tmp_path, body, *words, parameters=numbers).systems
    [known] = both(tmp_path)[0].systems
    t = torch.linspace(0, 30, 301, dtype=torch.float64)
    states = simulate(known, torch.tensor([[1.2, 0.3]]).double(), t)[0]
    [slope] = program_slopes(program, states, t, ["g"])
    exact = -torch.sin(states[:, 0])
    torch.testing.assert_close(slope[:, 1], exact, rtol=0, atol=1e-6)
    assert slope[:, 0].abs().max() < 1e-6
    # A busy machine makes a program expensive.
    monkeypatch.setattr("dashred.inference.forward.candidates.EXPENSIVE", np.inf)
    own = program.program or pytest.fail()
    step, counts = own.step, []

    def counted(states: Any, *given: Any) -> Any:
        counts.append(len(states))
        return step(states, *given)

    monkeypatch.setattr(own, "step", counted)
    found = {c.name: c for c in build_candidates(program, [], states, t)}
    # One step of each state, and two of each of 61 without a change and with three.
    assert sum(counts) == 301 + 61 * 2 * (1 + 3)
    expected = {c.name: c for c in build_candidates(known, [], states, t)}
    assert found.keys() == {"g"}
    assert found["g"].scale == pytest.approx(expected["g"].scale, rel=0.05)


def test_differences_have_the_size_that_single_precision_needs(tmp_path: Path) -> None:
    body = "simulator: {{function: tests.programs.{0}}}"
    names = ("pendulum", "pendulum_of_singles")
    double, single = (
        simulator(
            tmp_path, body.format(name), f"trust=tests.programs.{name}", "recording.path=r.csv"
        )
        for name in names
    )
    nodes = torch.randn((5, 2), generator=torch.Generator().manual_seed(1)).double().numpy()
    law = candidates(double.systems[0], ("omega", "omega"), ("omega", "theta**3"))
    xi = np.array([-0.3, 0.1])
    expected, slopes = double.linearise(nodes, law, xi)
    found, columns = single.linearise(nodes, law, xi)
    program = single.systems[0].program
    assert program is not None and 1e-8 < program.rounding < 1e-6
    np.testing.assert_allclose(found, expected, rtol=0, atol=1e-5)
    np.testing.assert_allclose(columns, slopes, rtol=0, atol=1e-2 * np.abs(slopes).max())
