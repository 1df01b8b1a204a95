"""The corrected configuration: it loads, and its equations are the simulator's plus the law."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
import torch
from torch import Tensor

from dashred.config import Config, load_config
from dashred.inference.fit.law import FittedParameter, Law
from dashred.inference.forward.candidates import ChangePrior
from dashred.inference.results.corrected_system import build_corrected_system
from dashred.inference.results.parameter_change import is_exact
from dashred.physics.backends.input_signals import InputSignals
from dashred.physics.system import System, Term
from dashred.physics.terms.library import evaluate_terms
from dashred.pipeline.outputs.corrected_config import write_corrected
from tests import laws


def load(path: Path, *words: str) -> tuple[Config, System]:
    if path.name == "corrected.yaml":
        words = (f"recording.path={path.with_name('my.csv')}", *words)
    config = load_config([f"conf={path}", *words], entry="train")
    return config, System(config.system, config.where)


def tendency(system: System, states: Tensor) -> Tensor:
    own = [Term(field, system.equations[field]) for field in system.fields]
    return evaluate_terms(system, own, states, 0.0)


def states(system: System) -> Tensor:
    generator = torch.Generator().manual_seed(0)
    shape = (3, len(system.fields), *system.grid.shape)
    return 1 + 0.1 * torch.randn(shape, generator=generator, dtype=torch.float64)


def driven(system: System) -> System:
    inputs = {name: np.array([0.3]) for name in system.config.inputs}
    return System(system.config, system.where, InputSignals(np.zeros(1), inputs))


def added(system: System, law: Law, where: Tensor) -> Tensor:
    expected = tendency(system, where)
    for candidate, value in zip(law.candidates, law.coefficients.tolist(), strict=True):
        columns = evaluate_terms(system, candidate.terms, where, 0.0)
        for term, column in zip(candidate.terms, columns, strict=True):
            expected[system.fields.index(term.equation)] += value * column
    return expected


def example(system: System) -> Law:
    found = [
        laws.term(system, "u", "u**3"),
        laws.term(system, "lam", "lam*d(u, x)"),
        laws.parameter(system, "nu"),
    ]
    return laws.law(found, [-0.0251, 1e-7, 0.0152])


@pytest.fixture
def mine(tmp_path: Path) -> Path:
    path = tmp_path / "mine.yaml"
    path.write_text(laws.TEXT + "seed: 4\n")
    return path


def test_it_loads_from_another_folder_and_is_the_simulator_plus_the_law(
    mine: Path, tmp_path: Path
) -> None:
    config, system = load(mine)
    law = example(system)
    folder = tmp_path / "elsewhere" / "deep"
    folder.mkdir(parents=True)
    write_corrected(folder / "corrected.yaml", config, system, law, "abc")
    again, corrected = load(folder / "corrected.yaml")
    where = states(system)
    torch.testing.assert_close(tendency(corrected, where), added(system, law, where))
    assert not torch.allclose(tendency(corrected, where), tendency(system, where))
    assert again.recording.twin is None and again.seed == 4
    assert again.system.start == config.system.start
    assert again.system.spin_up == config.system.spin_up == 1
    assert again.tracking.root == config.tracking.root
    assert again.tracking.experiment == "mine"
    assert [file.name for file in folder.iterdir()] == ["corrected.yaml"]


def test_it_has_the_time_step_that_the_law_needs(mine: Path, tmp_path: Path) -> None:
    config, system = load(mine)
    for dt, expected in ((None, 0.05), (0.0125, 0.0125)):
        path = tmp_path / "corrected.yaml"
        write_corrected(path, config, system, example(system), "abc", dt=dt)
        assert load(path)[1].dt == expected


def test_what_the_command_line_changed_is_kept_but_nothing_of_one_run(
    mine: Path, tmp_path: Path
) -> None:
    words = ["seed=7", "system.parameters.q=1.5", "shred.decoder=[32, 16]", "splits.time.test=0.3"]
    places = [f"output={tmp_path / 'out'}", f"tracking.root={tmp_path / 'runs'}", "tracking.run=x"]
    recording = [f"recording.path={tmp_path / 'r.nc'}", "recording.every=0.2"]
    config, system = load(mine, *words, *places, *recording)
    path = tmp_path / "corrected.yaml"
    write_corrected(path, config, system, example(system), "abc")
    text = path.read_text()
    assert str(tmp_path) not in text
    again, _ = load(path)
    assert (again.seed, again.shred.decoder, again.splits.time.test) == (7, [32, 16], 0.3)
    assert again.system.parameters == {"nu": pytest.approx(0.1152), "q": 1.5, "alpha": 0.3}
    assert again.recording.every == 0.2
    assert again.output is None and again.tracking.run is None


def test_the_header_says_what_was_added_and_from_what(mine: Path, tmp_path: Path) -> None:
    config, system = load(mine)
    path = tmp_path / "corrected.yaml"
    write_corrected(path, config, system, example(system), "0123456789abcdef0123")
    lines = path.read_text().splitlines()
    header = " ".join(line.removeprefix("# ") for line in lines if line.startswith("#"))
    assert "cubic damping of internal energy (saturation), (−0.0251 ± 0.0020)·u³" in header
    assert "nu is 0.1152 ± 0.0020, not 0.1" in header
    assert "0123456789abcdef… " not in header and "0123456789abcdef…, seed 4" in header
    assert "estimates.nc" in header
    assert max(map(len, lines)) <= 100
    assert "It is suggested." not in header
    write_corrected(
        path, config, system, example(system), "0123456789abcdef0123", "It is suggested."
    )
    assert "# It is suggested.\n" in path.read_text()
    assert load(path)[0].system.equations["u"] != config.system.equations["u"]


def test_an_empty_law_is_the_simulator_itself(mine: Path, tmp_path: Path) -> None:
    config, system = load(mine)
    path = tmp_path / "corrected.yaml"
    write_corrected(path, config, system, laws.law(), "abc")
    assert load(path)[0].system.equations == config.system.equations


@pytest.mark.parametrize("name", ["rde", "pendulum"])
def test_the_bundled_systems_can_be_corrected(name: str, tmp_path: Path) -> None:
    config = load_config([f"conf={name}"], entry="train")
    system = System(config.system, config.where)
    field = system.fields[-1]
    law = laws.law([laws.term(system, field, field)], [-0.08])
    path = tmp_path / "corrected.yaml"
    write_corrected(path, config, system, law, "abc")
    again, corrected = load(path)
    where = states(system)
    torch.testing.assert_close(tendency(corrected, where), added(system, law, where))
    assert system.lets.keys() == corrected.lets.keys()
    assert again.system.spread == config.system.spread
    assert again.simulation == config.simulation
    assert again.recording.every == config.recording.every
    assert again.recording.twin is None


def test_of_a_parameter_inside_an_exponential_the_tangent_is_added(tmp_path: Path) -> None:
    system = laws.declared(tmp_path)
    assert is_exact(system, "nu", 0.1) and is_exact(system, "q", 0.1)
    assert not is_exact(system, "alpha", 0.02)
    # Beside another parameter's new value it is the tangent at the old ones.
    law = laws.law([laws.parameter(system, "alpha"), laws.parameter(system, "q")], [0.02, 0.1])
    corrected, where = build_corrected_system(system, law), states(system)
    torch.testing.assert_close(tendency(corrected, where), added(system, law, where))
    assert corrected.config.parameters == system.config.parameters | {"q": pytest.approx(1.1)}


@pytest.mark.parametrize(
    ("name", "equation", "term"),
    [("mass_spring", "p", "p"), ("rlc", "phi", "phi**3"), ("wave", "p", "p")],
)
def test_a_port_hamiltonian_system_with_a_term_put_in_loads(
    name: str, equation: str, term: str, tmp_path: Path
) -> None:
    config, system = load(Path("conf") / f"{name}.yaml", "recording.twin=a")
    law = laws.law([laws.term(system, equation, term)], [-0.1])
    write_corrected(tmp_path / "corrected.yaml", config, system, law, "abc")
    again, corrected = load(tmp_path / "corrected.yaml")
    where = states(system)
    expected = added(driven(system), law, where)
    torch.testing.assert_close(tendency(driven(corrected), where), expected)
    assert config.system.structure is not None and again.system.structure is None
    assert "structure is left out" in " ".join((tmp_path / "corrected.yaml").read_text().split())


def test_a_port_hamiltonian_system_with_another_parameter_keeps_its_structure(
    tmp_path: Path,
) -> None:
    config, system = load(Path("conf/mass_spring.yaml"), "recording.twin=a")
    law = laws.law([laws.parameter(system, "k")], [0.3])
    write_corrected(tmp_path / "corrected.yaml", config, system, law, "abc")
    again, _ = load(tmp_path / "corrected.yaml")
    assert again.system.structure == config.system.structure


def test_settings_of_an_input_on_the_command_line_are_kept(tmp_path: Path) -> None:
    path = tmp_path / "driven.yaml"
    path.write_text("""
system:
  title: capacitor
  fields: {q: charge}
  inputs: {e: voltage}
  equations: {q: e - q}
  start: {q: 0}
  spread: {q: 0.1}
  integrator: {dt: 0.05}
recording: {path: my.csv, std: 5%}
""")
    words = "system.inputs.e.hold=true", "recording.std.q=7%", "discovery.weak=2"
    config = load_config([f"conf={path}", *words], entry="train")
    system = System(config.system, config.where)
    law = laws.law([laws.term(system, "q", "q**2")], [0.5])
    write_corrected(tmp_path / "corrected.yaml", config, system, law, "ab" * 32)
    again, corrected = load(tmp_path / "corrected.yaml")
    assert corrected.config.inputs["e"].hold and corrected.inputs == {"e": "voltage"}
    assert again.recording.std is None


def uncertain(system: System, law: Law, name: str, change: float) -> Law:
    """Return a law with a parameter that was fitted beside it."""
    prior = ChangePrior(0.0, system.config.parameter_spread[name])
    candidate = replace(laws.parameter(system, name), prior=prior)
    return replace(law, parameters=(FittedParameter(candidate, change, 0.001),))


@pytest.mark.parametrize(
    ("parameters", "words"),
    [
        ("parameters: {nu: {value: 0.1, spread: 0.05}, ", []),
        ("parameter_spread: {nu: 0.05}\n  parameters: {nu: 0.1, ", []),
        ("parameters: {nu: {value: 0.2, spread: 1}, ",
         ["system.parameters.nu={value: 0.1, spread: 0.05}"]),
        ("parameters: {nu: 0.1, ", ["system.parameters.nu.spread=0.05"]),
    ],
)  # fmt: skip
def test_fitted_parameters_are_in_it_without_a_spread(
    tmp_path: Path, parameters: str, words: list[str]
) -> None:
    path = tmp_path / "mine.yaml"
    path.write_text(laws.TEXT.replace("parameters: {nu: 0.1, ", parameters))
    config, system = load(path, *words)
    law = uncertain(system, laws.law([laws.term(system, "u", "u**3")], [-0.0251]), "nu", 0.0152)
    write_corrected(tmp_path / "corrected.yaml", config, system, law, "abc")
    again, corrected = load(tmp_path / "corrected.yaml")
    assert again.system.parameters == {"nu": pytest.approx(0.1152), "q": 1.0, "alpha": 0.3}
    assert again.system.parameter_spread == {}
    assert "spread" not in again.written["system"]
    header = (tmp_path / "corrected.yaml").read_text().partition("system:")[0]
    assert (
        "\n#\n# Fitted parameters:\n#  nu = 0.1152 ± 0.0020 (stated 0.1, spread 0.05)\n#\n"
        in header
    )
    assert "cubic damping" in header and "wrong" not in header
    where = states(system)
    nu = laws.law([*law.candidates, laws.parameter(system, "nu")], [-0.0251, 0.0152])
    torch.testing.assert_close(tendency(corrected, where), added(system, nu, where))


def test_beside_fitted_parameters_an_empty_law_says_nothing_of_wrong_ones(tmp_path: Path) -> None:
    path = tmp_path / "mine.yaml"
    path.write_text(laws.TEXT)
    config, system = load(path, "system.parameters.nu.spread=0.05")
    law = uncertain(system, laws.law(), "nu", 0.0152)
    write_corrected(tmp_path / "corrected.yaml", config, system, law, "abc")
    header = (tmp_path / "corrected.yaml").read_text()
    assert "# With the fitted parameters, the recording shows no missing term.\n" in header
    assert "wrong parameter" not in header


def test_what_the_command_line_removed_is_not_in_it(mine: Path, tmp_path: Path) -> None:
    path = tmp_path / "corrected.yaml"
    words = ["system.parameters.q=~", "system.equations.u=nu*lap(u)", "system.spin_up=2"]
    config, system = load(mine, *words)
    write_corrected(path, config, system, laws.law(), "abc")
    again, _ = load(path)
    assert again.system.parameters == {"nu": 0.1, "alpha": 0.3} and again.system.spin_up == 2
