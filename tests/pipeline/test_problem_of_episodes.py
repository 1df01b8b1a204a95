"""Posing a problem of several episodes: what is fitted of each, and what nothing has seen."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
import torch

from dashred.config import load_config
from dashred.core.errors import InputError
from dashred.data.episodes import Episode, Episodes
from dashred.data.io.write_netcdf import write_netcdf
from dashred.data.recording import Recording
from dashred.data.sensors import Sensor
from dashred.inference.fit.law import SensorFault
from dashred.pipeline.discovery.least_squares import build_least_squares, exact_simulator
from dashred.pipeline.input.build_problem import build_problem
from dashred.pipeline.networks.assimilation import sensor_data
from dashred.pipeline.problem import Problem
from dashred.pipeline.simulation.ensembles import simulate_ensemble, split_members
from dashred.pipeline.simulation.nominal_run import simulate_nominal
from dashred.reporting.text.sensor_faults import fault_text

SENSORS = tuple(Sensor(f"s{i}", "u", (0.3 + i,)) for i in range(6))
LENGTHS = {"a": (0.0, 41), "b": (60.0, 61), "c": (-5.0, 51)}


def episode(name: str) -> Episode:
    begin, count = LENGTHS[name]
    rng = np.random.default_rng(ord(name))
    times = begin + 0.1 * np.arange(count, dtype=np.float64)
    values = 1 + 0.3 * np.sin(times)[:, None] + 0.01 * rng.standard_normal((count, 6))
    return Episode(name, Recording(SENSORS, times, values))


def make_problem(quick: Path, folder: Path, *episodes: Episode) -> Problem:
    path = folder / "recording.nc"
    write_netcdf(Episodes(episodes), path, ["x"])
    return build_problem(load_config([f"conf={quick}", f"recording.path={path}"], entry="train"))


def test_the_last_fifth_of_each_is_held_out_and_of_three_the_last_whole(quick, tmp_path):
    problem = make_problem(quick, tmp_path, *map(episode, "abc"))
    assert [p.name for p in problem.episodes] == ["b", "a"]
    assert [p.name for p in problem.whole] == ["c"]
    [whole] = problem.whole
    for part, share in ((problem, 0.8), (problem.others[0], 0.8), (whole, 0.1)):
        first, last = part.times[0], part.times[-1]
        assert part.split.time_end == pytest.approx(float(first + share * (last - first)))
        assert len(part.split.fit.times) + len(part.split.heldout.times) == len(part.times)
        assert part.split.test == problem.split.test
        assert part.split.inputs == problem.split.inputs
    assert float(problem.times[0]) == 60


def test_of_two_none_is_held_out_whole(quick, tmp_path):
    problem = make_problem(quick, tmp_path, *map(episode, "ab"))
    assert [p.name for p in problem.episodes] == ["b", "a"]
    assert not problem.whole
    fault = SensorFault("spikes", "s1", 3.0, None, None, episode=1)
    told = "sensor s1 has 3 spikes, in episode 'a'"
    assert fault_text(problem.fault_details(fault)) == told


def test_of_more_episodes_than_members_the_last_have_none(quick, tmp_path):
    problem = make_problem(quick, tmp_path, *map(episode, "abc"))
    assert [members for _, _, members, _ in split_members(problem, 5)] == [3, 2]
    assert [members for _, _, members, _ in split_members(problem, 1)] == [1]


def test_nothing_held_out_moves_what_is_fitted(quick, tmp_path):
    before = make_problem(quick, tmp_path, *map(episode, "abc"))
    changed = []
    for part, end in zip(map(episode, "abc"), (3.2, 64.8, -100.0), strict=True):
        values = part.recording.values.copy()
        values[part.recording.times > end + 1e-9] += 10
        sensors, times = part.recording.sensors, part.recording.times
        changed.append(Episode(part.name, Recording(sensors, times, values)))
    after = make_problem(quick, tmp_path, *changed)
    assert after.noise == before.noise
    for one, other in zip(after.episodes, before.episodes, strict=True):
        np.testing.assert_array_equal(one.split.fit.values, other.split.fit.values)
    for name in ("windows", "fitted"):
        mine, yours = getattr(sensor_data(after), name), getattr(sensor_data(before), name)
        torch.testing.assert_close(mine, yours, equal_nan=True, rtol=0, atol=0)


def test_no_window_spans_two_episodes(quick, tmp_path):
    problem = make_problem(quick, tmp_path, *map(episode, "ab"))
    data = sensor_data(problem)
    count = len(problem.split.fit.times)
    assert (
        len(data.windows)
        == len(data.fitted)
        == sum(len(part.split.fit.times) for part in problem.episodes)
    )
    # Before an episode's first sample there is that sample alone.
    first = data.windows[count]
    torch.testing.assert_close(first, first[-1:].expand_as(first))
    own = torch.from_numpy(problem.others[0].split.fit.select(problem.split.inputs).values)
    torch.testing.assert_close(data.windows[count + 3, -4:], own[:4].float())


def test_its_objective_has_a_start_for_each_and_all_samples_once(quick, tmp_path):
    problem = make_problem(quick, tmp_path, *map(episode, "abc"))
    nominal = simulate_nominal(problem, {})
    simulator = exact_simulator(problem, [])
    assert len(simulator.parts) == len(problem.episodes)
    objective = build_least_squares(problem, simulator, nominal.start, [], 1.0)
    assert objective.modes == 2 * nominal.prior.size
    fitted = len(problem.split.fit.sensors)
    assert objective.noise.count == fitted * sum(
        len(part.split.fit.times) for part in problem.episodes
    )
    # Five samples of each: a horizon grows in all of them.
    assert objective.truncate(5).noise.count == 2 * 5 * fitted
    cost, _ = objective.values(torch.zeros(1, objective.modes).double())
    assert bool(torch.isfinite(cost).all())
    members = problem.config.simulation.members
    assert len(simulate_ensemble(problem, nominal, {}).states) == members


def silent(name: str, until: int | None = None) -> Episode:
    """Return an episode without values of s3 before a sample."""
    part = episode(name).recording
    values = part.values.copy()
    values[:until, 3] = np.nan
    return Episode(name, Recording(SENSORS, part.times, values))


def test_a_sensor_needs_values_before_the_held_out_time_in_one_episode(quick, tmp_path):
    with pytest.raises(InputError, match="sensor 's3' has no value until"):
        make_problem(quick, tmp_path, silent("b", 58), silent("a", 38))
    with pytest.raises(InputError, match="sensor 's3' has no values"):
        make_problem(quick, tmp_path, silent("b"), silent("a"))


@pytest.mark.parametrize(("first", "second"), [("a", "b"), ("b", "a")])
def test_an_episode_may_lack_a_sensor_that_another_one_has(quick, tmp_path, first, second):
    problem = make_problem(quick, tmp_path, silent(first), episode(second))
    nominal = simulate_nominal(problem, {})
    objective = build_least_squares(problem, exact_simulator(problem, []), nominal.start, [], 1.0)
    at = [part.name for part in problem.episodes].index(first)
    names = problem.split.fit.names
    recorded = objective.recorded.unflatten(1, (2, len(names)))[:, at, names.index("s3")]
    assert recorded.isnan().all()
    cost, _ = objective.values(torch.zeros(1, objective.modes, dtype=torch.float64))
    assert bool(cost.isfinite().all())
    counts = [len(part.split.fit.times) for part in problem.episodes]
    windows = sensor_data(problem).windows.split(counts)[at]
    assert bool(windows.isfinite().all())
    other = next(part for part in problem.episodes if part.name == second)
    usual = float(other.split.fit.select(["s3"]).values.mean())
    read = windows[..., problem.split.inputs.index("s3")]
    torch.testing.assert_close(read, torch.full_like(read, usual))


def test_an_episode_that_is_too_short_is_refused_by_name(quick, tmp_path):
    short = episode("a").recording.between(0.0, 0.4)
    with pytest.raises(InputError, match="episode 'short': 5 samples are too few"):
        make_problem(quick, tmp_path, episode("b"), Episode("short", short))


DOSED = """
system:
  title: a drug
  fields: {A: drug}
  inputs: {dose: dose}
  equations: {A: -A}
  start: {A: dose}
  spread: {A: 0.5}
  integrator: {dt: 0.05}
"""


@pytest.mark.parametrize(("second", "is_one"), [(4.2, True), (6.0, False)])
def test_a_start_that_reads_an_input_is_the_same_in_all_episodes(tmp_path, second, is_one):
    rows = [
        f"{name},{0.1 * i:.1f},{dose * np.exp(-0.1 * i):.4f},{dose}"
        for name, dose in (("x", 4.0), ("y", second))
        for i in range(40)
    ]
    (tmp_path / "drug.csv").write_text("\n".join(["episode,time,A,dose", *rows, ""]))
    (tmp_path / "drug.yaml").write_text(DOSED + "recording: {path: drug.csv}\n")
    config = load_config([f"conf={tmp_path / 'drug.yaml'}"], entry="train")
    if is_one:
        # The difference is within the spread.
        assert build_problem(config).episodes
        return
    with pytest.raises(InputError, match="the start of A reads an input that differs") as told:
        build_problem(config)
    assert "fitted separately in each episode" in str(told.value)
