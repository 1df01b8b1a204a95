"""Programs that fail in the middle of the record, or take long."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
import pytest
from scipy.integrate import solve_ivp

from dashred.config import Config, load_config
from dashred.core.errors import InputError
from dashred.pipeline import equations
from dashred.pipeline.input.build_problem import build_problem
from dashred.pipeline.simulation.nominal_run import simulate_nominal
from tests.pipeline.simulation.conftest import SHORT_RUN

TEXT = (
    """
system:
  title: pendulum
  fields: {theta: angle, omega: rate}
  parameters: {g: 4.0}
  simulator: {function: NAME}
  start: {theta: 1.2, omega: 0}
  spread: {theta: 0.1, omega: 0.2}
recording: {path: recording.csv, std: 1%}
simulation: {members: 24, held_out: 6, terms: 1}"""
    + SHORT_RUN
)
TIMES = np.linspace(0, 6, 41)


def config_of(folder: Path, name: str, *words: str) -> Config:
    """Return the configuration of a pendulum whose damping is hidden, beside its recording."""

    def tendency(_: float, u: np.ndarray) -> list[float]:
        return [u[1], -4 * np.sin(u[0]) - 0.15 * u[1]]

    exact = solve_ivp(tendency, (0, 6), [1.25, 0.1], t_eval=TIMES, rtol=1e-9, atol=1e-9).y.T
    noise = np.random.default_rng(21).standard_normal(exact.shape)
    rows = np.column_stack([TIMES, exact + 0.01 * exact.std(axis=0) * noise])
    header = "time,theta,omega"
    np.savetxt(folder / "recording.csv", rows, delimiter=",", header=header, comments="")
    name = f"tests.programs.{name}"
    (folder / "pendulum.yaml").write_text(TEXT.replace("NAME", name))
    return load_config([f"conf={folder / 'pendulum.yaml'}", f"trust={name}", *words], entry="test")


def test_a_program_that_fails_at_recorded_states_is_told_with_its_words(tmp_path: Path) -> None:
    problem = build_problem(config_of(tmp_path, "pendulum_without_data"))
    with pytest.raises(InputError, match=r"fails in \d+ of \d+ parts of the recording") as error:
        simulate_nominal(problem, {})
    assert "no wind data after t = 2" in str(error.value.hint)


@pytest.mark.slow
def test_a_program_that_takes_long_has_its_law_within_the_budget(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv("XDG_STATE_HOME", str(tmp_path / "state"))
    words = (
        "budget=60",
        "simulation.members=192",
        f"output={tmp_path / 'found'}",
        f"tracking.root={tmp_path}",
    )
    output = equations.analyse_equations(config_of(tmp_path, "slow_pendulum", *words))
    findings = json.loads((output / "findings.json").read_text())
    assert "training SHRED on any simulation" in findings["budget"]["not_tried"]
    assert findings["verdict"] == "missing-term"
    [term] = findings["terms"]
    assert abs(term["coefficient"] + 0.15) < 0.01
