"""Ensembles on disk: the members of those in memory, also after an interruption."""

from __future__ import annotations

import json
import multiprocessing
import os
import signal
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import torch
from torch import Tensor

from dashred.core.errors import InputError
from dashred.physics.runs import ensemble_store, members_on_disk
from dashred.physics.runs.ensemble import Discrepancies, Ensemble, MemberSource, draw_ensemble
from dashred.physics.runs.ensemble_store import BATCHES, STATES
from dashred.physics.runs.initial_state_prior import StartPrior, nominal_start
from dashred.physics.runs.members_on_disk import BatchSize, draw_ensemble_to_disk
from dashred.physics.runs.stored_states import StoredStates
from dashred.physics.solvers.simulate import Progress, simulate
from dashred.physics.system import System
from dashred.physics.terms.library import build_library

TIMES = torch.linspace(0, 1, 12, dtype=torch.float64)
MEMBERS = 10


@pytest.fixture(autouse=True)
def small_batches(monkeypatch: pytest.MonkeyPatch) -> None:
    """Three members at once, of which four samples are written at once, in two chunks."""
    state = 8 * 2 * 32
    monkeypatch.setattr(members_on_disk, "thread_count", lambda: 3)
    monkeypatch.setattr(members_on_disk, "WORK_BYTES", 3 * 3 * 4 * state)
    monkeypatch.setattr(ensemble_store, "CHUNK_BYTES", 2 * state)


def source_of(
    system: System,
    progress: Progress | None = None,
    amplitude: float = 0.2,
    seed: int = 3,
) -> MemberSource:
    start = nominal_start(system)
    nominal = simulate(system, start, TIMES)[0]
    rms = nominal.transpose(0, 1).flatten(1).pow(2).mean(1).sqrt()
    prior = StartPrior(system, start[0], rms, 8)
    random = Discrepancies(build_library(system, None), 2, amplitude)
    return MemberSource(
        system, TIMES, prior, nominal, random, np.random.default_rng(seed), progress
    )


def in_memory(system: System, **changed: Any) -> Ensemble:
    return draw_ensemble(source_of(system, **changed), MEMBERS)


def to_disk(
    system: System,
    folder: Path,
    run: str = "run",
    progress: Progress | None = None,
    **changed: Any,
) -> Ensemble:
    return draw_ensemble_to_disk(source_of(system, progress, **changed), MEMBERS, folder, run)


def read(ensemble: Ensemble) -> Tensor:
    assert isinstance(ensemble.states, StoredStates)
    return ensemble.states[:, :]


def test_a_batch_fits_into_its_memory_and_is_made_of_chunks() -> None:
    assert BatchSize.of(MEMBERS, 12, 8 * 2 * 32) == (3, 4)
    assert BatchSize.of(2, 4, 8 * 2 * 32) == (2, 4)
    # Not even one sample of each member fits.
    assert BatchSize.of(MEMBERS, 12, 10**6) == (3, 2)


def test_members_are_those_of_an_ensemble_in_memory(reaction: System, tmp_path: Path) -> None:
    expected, found = in_memory(reaction), to_disk(reaction, tmp_path / "store")
    assert torch.equal(found.coefficients, expected.coefficients)
    torch.testing.assert_close(read(found), expected.states, rtol=1e-12, atol=1e-12)


def test_members_that_leave_the_bounds_are_drawn_again(reaction: System, tmp_path: Path) -> None:
    # Errors as large as the tendencies let some members blow up.
    expected = in_memory(reaction, amplitude=3.0)
    found = to_disk(reaction, tmp_path / "store", amplitude=3.0)
    kept = json.loads((tmp_path / "store" / BATCHES).read_text())["kept"]
    assert sum(map(sum, kept)) == MEMBERS < sum(map(len, kept))
    assert torch.equal(found.coefficients, expected.coefficients)
    torch.testing.assert_close(read(found), expected.states, rtol=1e-9, atol=1e-9)


def counted(monkeypatch: pytest.MonkeyPatch) -> list[int]:
    """Return a list that gets the number of members of every simulation."""
    calls: list[int] = []

    def counting(system: System, start: Tensor, *given: object, **options: object) -> Tensor:
        calls.append(len(start))
        return simulate(system, start, *given, **options)  # type: ignore[arg-type]

    monkeypatch.setattr(members_on_disk, "simulate", counting)
    return calls


def test_an_interrupted_ensemble_is_continued(
    reaction: System, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    def interrupt(done: float) -> None:
        if done > 0.7:
            raise KeyboardInterrupt

    with pytest.raises(KeyboardInterrupt):
        to_disk(reaction, tmp_path / "store", progress=interrupt)
    calls = counted(monkeypatch)
    found = to_disk(reaction, tmp_path / "store")
    # Two of four batches were complete; each is simulated in three parts.
    assert calls == [3, 3, 3, 1, 1, 1]
    torch.testing.assert_close(read(found), in_memory(reaction).states, rtol=1e-12, atol=1e-12)
    calls.clear()
    again = to_disk(reaction, tmp_path / "store")
    assert calls == [] and torch.equal(read(again), read(found))


def test_the_store_of_another_ensemble_is_replaced(
    reaction: System, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    to_disk(reaction, tmp_path / "store")
    calls = counted(monkeypatch)
    for changed in ({"run": "other code"}, {"seed": 4}, {"amplitude": 0.1}):
        calls.clear()
        to_disk(reaction, tmp_path / "store", **changed)
        assert sum(calls) == 3 * MEMBERS
    (tmp_path / "store" / BATCHES).write_text("{broken")
    calls.clear()
    found = to_disk(reaction, tmp_path / "store")
    assert sum(calls) == 3 * MEMBERS
    torch.testing.assert_close(read(found), in_memory(reaction).states, rtol=1e-12, atol=1e-12)


def _killed(system: System, folder: Path) -> None:
    def kill(done: float) -> None:
        if done > 0.5:
            os.kill(os.getpid(), signal.SIGKILL)

    to_disk(system, folder, progress=kill)


def test_an_ensemble_of_a_killed_process_is_continued(
    reaction: System, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    process = multiprocessing.get_context("fork").Process(
        target=_killed, args=(reaction, tmp_path / "store")
    )
    process.start()
    process.join()
    assert process.exitcode == -signal.SIGKILL
    calls = counted(monkeypatch)
    found = to_disk(reaction, tmp_path / "store")
    assert 0 < sum(calls) < 3 * MEMBERS
    torch.testing.assert_close(read(found), in_memory(reaction).states, rtol=1e-12, atol=1e-12)


def test_a_store_with_a_missing_chunk_is_refused(reaction: System, tmp_path: Path) -> None:
    found = to_disk(reaction, tmp_path / "store")
    (tmp_path / "store" / STATES / "c" / "4" / "1" / "0" / "0").unlink()
    with pytest.raises(InputError, match=r"samples 0 to 11 of member 4 are missing") as error:
        read(found)
    assert error.value.where == str(tmp_path / "store")


def test_a_damaged_store_is_refused(reaction: System, tmp_path: Path) -> None:
    to_disk(reaction, tmp_path / "store")
    (tmp_path / "store" / STATES / "zarr.json").write_text("{}")
    with pytest.raises(InputError, match="not a readable store of simulations"):
        to_disk(reaction, tmp_path / "store")
