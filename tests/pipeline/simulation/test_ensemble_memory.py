"""Ensembles that take too much memory are kept on disk, and give the same training data."""

from __future__ import annotations

import json
from dataclasses import replace
from functools import partial
from pathlib import Path
from typing import Any

import pytest
import torch
from torch import Tensor

from dashred.config import load_config
from dashred.core.errors import InputError
from dashred.core.tracking import NullTracker
from dashred.inference.initial_state.first_guesses import (
    FirstGuessSettings,
    Readings,
    first_guesses,
)
from dashred.physics.runs import ensemble_store, members_on_disk, stored_states
from dashred.physics.runs.ensemble import Ensemble, MemberSource
from dashred.physics.runs.stored_states import StoredStates
from dashred.physics.solvers import simulate as solver
from dashred.physics.system import System
from dashred.physics.terms.library import resolve
from dashred.pipeline import equations
from dashred.pipeline.check.context import build_check_context
from dashred.pipeline.check.memory import ensemble_memory_remarks
from dashred.pipeline.input.build_problem import build_problem
from dashred.pipeline.networks.training import train_shred
from dashred.pipeline.problem import Problem
from dashred.pipeline.simulation import ensemble_memory
from dashred.pipeline.simulation.ensemble_memory import memory_of, plan_memory
from dashred.pipeline.simulation_runs import SimulationRuns, simulate
from datamodules import SimulationDataModule
from tests.ring_recording import write_ring_recording

GIB = 2**30
SYSTEM = """\
system:
  title: Burgers
  axes: {x: {length: 2*pi, points: 32}}
  fields: {u: velocity}
  parameters: {nu: 0.2}
  equations: {u: "-d(u**2/2, x) + nu*lap(u)MISSING"}
  start: {u: 1 + 0.5*cos(x)}
  spread: {u: 10%, length: 1.0}
  integrator: {dt: 0.05}
"""
SETTINGS = """
recording: {path: recording.csv, sensors: sensors.csv}
splits: {sensors: {validate: 1, test: 1, extra: 1}}
library: {u: [u, u**2, "d(u, x)"]}
simulation: {members: 24, held_out: 6, terms: 1}
shred: {lags: 5, latent: 8, decoder: [16], modes: 8, epochs: 4, steps: 7, batch: 8, rate: 2e-2}
assimilation: {epochs: 2, width: 8}
latent_sindy: {steps: [1, 2], bootstraps: 3, begins: 3}
surrogate: {members: 12}
threads: 1
"""


@pytest.fixture(scope="module")
def case(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The configuration of a system whose recording has one more term."""
    folder = tmp_path_factory.mktemp("ensembles")
    times = 0.1 * torch.arange(41, dtype=torch.float64)
    lawful = SYSTEM.replace("MISSING", " - 0.1*u")
    write_ring_recording(folder, lawful, (1.0, 0.5), times, 8, 0.01)
    path = folder / "case.yaml"
    path.write_text(SYSTEM.replace("MISSING", "") + SETTINGS, encoding="utf-8")
    return path


@pytest.fixture
def large(monkeypatch: pytest.MonkeyPatch) -> None:
    """Take every ensemble for a large one, whose batches, blocks and chunks are small."""
    state = 8 * 32
    monkeypatch.setattr(ensemble_memory, "ENSEMBLE_COPIES", 1e9)
    monkeypatch.setattr(ensemble_store, "CHUNK_BYTES", 4 * state)
    monkeypatch.setattr(members_on_disk, "WORK_BYTES", 3 * 5 * 16 * state)
    monkeypatch.setattr(stored_states, "BLOCK_BYTES", 8 * state)


def problem_of(case: Path, folder: Path, *words: str) -> Problem:
    places = [f"output={folder / 'output'}", f"tracking.root={folder / 'mlruns'}"]
    return build_problem(load_config([f"conf={case}", *places, *words], entry="test"))


def data_of(runs: SimulationRuns) -> SimulationDataModule:
    problem, ensemble = runs.problem, runs.ensemble
    assert ensemble is not None
    fit = problem.split.fit.select(problem.split.inputs)
    noise, settings = problem.noise_of(fit.names), problem.config.shred
    return SimulationDataModule(
        ensemble, problem.operator(fit), noise, settings.lags, settings.modes, 6, settings.batch, 0
    )


def guesses_of(runs: SimulationRuns) -> dict[str, Tensor]:
    """Return the centre of every first guess."""
    problem, fit = runs.problem, runs.problem.split.fit
    assert runs.ensemble is not None
    readings = Readings(
        problem.times[: len(fit.times)],
        torch.from_numpy(fit.values),
        problem.operator(fit),
        problem.noise_of(fit.names),
    )
    found = first_guesses(
        problem.ensemble_system,
        runs.nominal.prior,
        runs.ensemble,
        resolve(problem.system, problem.library),
        readings,
        None,
        replace(FirstGuessSettings(), analogs=20),
    )
    return {
        name: model.start(torch.zeros((1, model.size)).double()) for name, model in found.items()
    }


def test_the_training_data_are_those_of_an_ensemble_in_memory(
    case: Path, tmp_path: Path, request: pytest.FixtureRequest
) -> None:
    plain = simulate(problem_of(case, tmp_path), {})
    request.getfixturevalue("large")
    kept = simulate(problem_of(case, tmp_path), {})
    assert plain.ensemble is not None and kept.ensemble is not None
    assert isinstance(plain.ensemble.states, Tensor)
    assert isinstance(kept.ensemble.states, StoredStates)
    close = partial(torch.testing.assert_close, rtol=1e-9, atol=1e-9)
    close(kept.ensemble.states[:, :], plain.ensemble.states)
    first, second = data_of(plain), data_of(kept)
    for name, value in first.pod.state_dict().items():
        torch.testing.assert_close(second.pod.state_dict()[name], value, rtol=1e-7, atol=1e-7)
    close(second.scaler.std, first.scaler.std)
    for loaders in ("train_dataloader", "val_dataloader"):
        pairs = zip(getattr(first, loaders)(), getattr(second, loaders)(), strict=True)
        for one, other in pairs:
            for expected, found in zip(one, other, strict=True):
                torch.testing.assert_close(found, expected, rtol=1e-5, atol=1e-6)
    expected, found = guesses_of(plain), guesses_of(kept)
    assert found.keys() == expected.keys() >= {"prior", "blue"}
    for name, centre in expected.items():
        torch.testing.assert_close(found[name], centre, rtol=1e-6, atol=1e-6)


def test_a_network_trained_from_disk_is_as_good(
    case: Path, tmp_path: Path, request: pytest.FixtureRequest
) -> None:
    errors = []
    for place in ("memory", "disk"):
        if place == "disk":
            request.getfixturevalue("large")
        runs = simulate(problem_of(case, tmp_path), {})
        assert runs.ensemble is not None
        network = train_shred(runs.problem, runs.ensemble, NullTracker(), {}, "SHRED")
        errors.append(network.test_rmse["all"])
    assert errors[1] == pytest.approx(errors[0], rel=1e-3)


@pytest.mark.slow
def test_a_whole_run_keeps_its_ensembles_on_disk_and_removes_them(
    case: Path, train, large, monkeypatch: pytest.MonkeyPatch
) -> None:
    drawn = []

    def noted(source: MemberSource, members: int, folder: Path, run: str) -> Ensemble:
        drawn.append(folder.name)
        return members_on_disk.draw_ensemble_to_disk(source, members, folder, run)

    monkeypatch.setattr(ensemble_memory, "draw_ensemble_to_disk", noted)
    ended = train(f"conf={case}", "tracking.model=false")
    assert ended.code == 0, ended.err
    assert drawn == ["ensemble 0", "corrected ensemble 0", "simulate for the observer 0"]
    assert "24 members, with random discrepancies, on disk" in ended.out
    assert json.loads(ended.read("findings.json"))["verdict"] == "missing-term"
    assert not [path for path in ended.output.iterdir() if "ensembles" in path.name]


def test_a_run_that_is_interrupted_keeps_its_ensemble_for_the_next(
    case: Path, train, large, monkeypatch: pytest.MonkeyPatch
) -> None:
    def interrupted(*_: object, **__: object) -> None:
        raise KeyboardInterrupt

    words = (f"conf={case}", "tracking.model=false")
    with monkeypatch.context() as patch:
        patch.setattr(vars(equations)["training"], "train_shred", interrupted)
        ended = train(*words)
    assert ended.code == 130
    [batches] = (ended.output / ".ensembles").glob("ensemble 0/batches.json")
    assert sum(map(sum, json.loads(batches.read_text())["kept"])) == 24
    simulated = []
    original = solver.simulate

    def counting(system: System, start: Tensor, *given: Any, **options: Any) -> Tensor:
        simulated.append(len(start))
        return original(system, start, *given, **options)

    monkeypatch.setattr(members_on_disk, "simulate", counting)
    monkeypatch.setattr("dashred.pipeline.equations.discover", interrupted)
    assert train(*words).code == 130
    assert simulated == []


def test_the_plan_takes_the_disk_only_if_memory_does_not_suffice(case: Path) -> None:
    config = load_config([f"conf={case}", "simulation.memory=4 GiB"], entry="test")
    small = plan_memory(config, 64**2, 60, 60, 200)
    assert not small.is_on_disk and small.peak == small.in_memory
    large = plan_memory(config, 512**2, 40, 50, 200)
    assert large.is_on_disk and large.ensemble == 8 * 512**2 * 40 * 200
    assert large.peak == large.on_disk < large.limit == 4 * GIB < large.in_memory
    # The memory on disk does not grow with the number of members.
    assert plan_memory(config, 512**2, 40, 50, 2000).peak == large.peak


def test_a_limit_below_what_the_disk_needs_is_refused(case: Path) -> None:
    config = load_config([f"conf={case}", "simulation.memory=1 GiB"], entry="test")
    with pytest.raises(
        InputError, match="even with the ensemble on disk, more than 1 GiB"
    ) as error:
        plan_memory(config, 512**2, 40, 50, 200)
    assert error.value.where == "command line"


@pytest.mark.parametrize("text", ["4 parsecs", "'4'", "lots", "0 GiB"])
def test_a_limit_without_a_unit_of_memory_is_refused(case: Path, text: str) -> None:
    with pytest.raises(InputError, match="is not an amount of memory") as error:
        load_config([f"conf={case}", f"simulation.memory={text}"], entry="test")
    assert error.value.where == "command line"


def test_a_disk_that_is_too_small_ends_the_run_before_the_ensemble(
    case: Path, train, large, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("dashred.core.files.scratch.MARGIN", 2**60)
    ended = train(f"conf={case}")
    assert ended.code == 2
    assert "on disk, but only" in ended.err and "Traceback" not in ended.err
    assert not (ended.output / ".ensembles").exists()


def test_the_larger_ensemble_is_planned_beside_the_other(case: Path, tmp_path: Path) -> None:
    plain = memory_of(problem_of(case, tmp_path))
    problem = problem_of(case, tmp_path, "surrogate.members=48")
    larger, state = memory_of(problem), 8 * 32 * len(problem.split.fit.times)
    assert plain.ensemble == 24 * state and larger.ensemble == 48 * state
    grown = ensemble_memory.ENSEMBLE_COPIES * 24 + 12
    assert larger.in_memory - plain.in_memory == pytest.approx(grown * state, rel=0.1)


def test_a_check_tells_where_the_ensembles_are_kept(
    case: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    words = [f"conf={case}", f"output={tmp_path / 'output'}", "simulation.memory=4 GiB"]
    context = build_check_context(load_config(words, entry="check"))
    [remark] = ensemble_memory_remarks(context)
    assert "may take 4 GiB: the ensemble of 0.19 MiB is kept in memory" in remark.text
    monkeypatch.setattr(ensemble_memory, "ENSEMBLE_COPIES", 1e9)
    where, space = ensemble_memory_remarks(context)
    assert "kept on disk and read in parts" in where.text
    assert f"0.29 MiB in {tmp_path / 'output' / '.ensembles'}" in space.text
    assert not (tmp_path / "output").exists()
    monkeypatch.setattr("dashred.core.files.scratch.MARGIN", 2**60)
    with pytest.raises(InputError, match="on disk, but only"):
        list(ensemble_memory_remarks(context))
