"""A simulator that blows up without the term it lacks is restarted along the readings."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
import pytest
from scipy.integrate import solve_ivp

from dashred.config import load_config
from dashred.core.budget import OutOfTimeError
from dashred.pipeline import simulation_runs
from dashred.pipeline.input.build_problem import build_problem
from dashred.pipeline.simulation.nominal_run import simulate_nominal
from dashred.pipeline.simulation.resolution_check import check_discretisation
from dashred.pipeline.simulation.segment_resolution import _typical_change
from tests.pipeline.simulation.conftest import SHORT_RUN

TEXT = (
    """
system:
  title: jerk circuit
  fields: {x: voltage, y: its rate, z: its jerk}
  equations: {x: y, y: z, z: -1.1*z - 0.9*x + 0.75*x**2}
  start: {x: 0.1, y: 0.1, z: 0.1}
  spread: {x: 0.05, y: 0.05, z: 0.05}
  integrator: {method: rk4, dt: 0.02}
recording: {path: recording.csv}
splits: {sensors: {validate: 0, test: 0, extra: 0}}
simulation: {members: 24, held_out: 6, terms: 1}"""
    + SHORT_RUN
)
TIMES = np.linspace(0, 30, 301)
# The coefficient of y in the equation of z.
TERM = -1.15


@pytest.fixture(scope="module")
def circuit(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The configuration beside its recording."""

    def tendency(_: float, u: np.ndarray) -> list[float]:
        x, y, z = u
        return [y, z, -1.1 * z - 0.9 * x + 0.75 * x**2 + TERM * y]

    exact = solve_ivp(tendency, (0, 30), [0.12, 0.08, 0.11], t_eval=TIMES, rtol=1e-9, atol=1e-9).y.T
    readings = exact + 0.02 * exact.std(axis=0) * np.random.default_rng(5).standard_normal((301, 3))
    folder = tmp_path_factory.mktemp("circuit")
    rows = np.column_stack([TIMES, readings])
    np.savetxt(folder / "recording.csv", rows, delimiter=",", header="time,x,y,z", comments="")
    (folder / "circuit.yaml").write_text(TEXT)
    return folder / "circuit.yaml"


def test_scales_come_from_restarted_runs(circuit: Path) -> None:
    problem = build_problem(load_config([f"conf={circuit}"], entry="test"))
    nominal = simulate_nominal(problem, {})
    assert not np.isfinite(nominal.states.numpy()).all()
    [reference] = nominal.references
    assert reference.shape == nominal.states.shape and np.isfinite(reference.numpy()).all()
    assert float(reference.abs().max()) < 10 * np.abs(problem.split.fit.values).max()
    assert check_discretisation(problem, nominal, {}).error < 1e-4


def test_the_term_that_keeps_it_bounded_is_found(circuit: Path, train) -> None:
    ended = train(f"conf={circuit}", f"recording.path={circuit.parent / 'recording.csv'}")
    assert ended.code == 0, ended.err
    findings = json.loads(ended.read("findings.json"))
    assert findings["verdict"] == "missing-term"
    [term] = findings["terms"]
    assert (term["equation"], term["term"]) == ("z", "y")
    low, high = term["ci95"]
    assert low < TERM < high
    errors = findings["fit"]["heldout_time"]
    assert errors["simulation_refit"] is None and errors["corrected"] < 0.2
    assert "the run without the law diverges" in ended.out


def test_without_time_for_the_ensemble_a_law_is_kept(
    circuit: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    def no_time(*_: object) -> None:
        raise OutOfTimeError

    monkeypatch.setattr(simulation_runs, "simulate_ensemble", no_time)
    problem = build_problem(load_config([f"conf={circuit}"], entry="test"))
    runs = simulation_runs.simulate(problem, {})
    assert runs.segments is not None and runs.ensemble is not None
    assert len(runs.ensemble.states) == 24
    assert "training SHRED on the simulator without the law" in runs.problem.budget.not_tried


def test_a_field_without_a_sensor_has_no_range_to_leave(tmp_path: Path) -> None:
    text = TEXT.replace("{x: y, y: z, z: -1.1*z - 0.9*x + 0.75*x**2}", "{x: y, y: z, z: -y}")
    (tmp_path / "circuit.yaml").write_text(text.replace("z: 0.1}\n  spread", "z: 0}\n  spread"))
    readings = 0.1 + 0.1 * np.sin(TIMES)
    np.savetxt(
        tmp_path / "recording.csv",
        np.column_stack([TIMES, readings]),
        delimiter=",",
        header="time,x",
        comments="",
    )
    problem = build_problem(load_config([f"conf={tmp_path}/circuit.yaml"], entry="test"))
    assert simulate_nominal(problem, {}).restarted == ()


def test_segments_that_are_about_to_blow_up_do_not_decide_the_resolution() -> None:
    rng = np.random.default_rng(0)
    fine = rng.standard_normal((20, 5, 2))
    coarse = fine + 1e-3
    coarse[:1] += 1e3
    found = _typical_change(coarse, fine, np.zeros(2), np.ones(2))
    assert found == pytest.approx(1e-3, rel=1e-6)
    coarse[:12] = np.nan
    fine[:12] = np.nan
    assert _typical_change(coarse, fine, np.zeros(2), np.ones(2)) == np.inf


def test_what_follows_after_a_segment_has_left_the_recording_does_not_count() -> None:
    rng = np.random.default_rng(0)
    fine = rng.standard_normal((20, 5, 2))
    fine[:, 3:] *= 1e4
    coarse = fine * 1.001
    found = _typical_change(coarse, fine, np.zeros(2), np.ones(2))
    assert 1e-4 < found < 5e-3
    # Readings that are out of range at once say nothing.
    fine[:12, 1] = 1e4
    assert _typical_change(coarse, fine, np.zeros(2), np.ones(2)) == np.inf
