"""A whole analysis on a cluster: the same findings, and what is kept when the cluster is lost."""

from __future__ import annotations

import json
import shutil
from pathlib import Path

import pytest

from dashred.core.cluster.calls import ClusterCalls, NotAnsweredError
from dashred.core.cluster.word import WHERE
from dashred.core.errors import WRONG_INPUT
from dashred.inference.forward.columns import column_blocks
from dashred.physics.runs import members
from tests.conftest import Ended, Run

# 2048 values of a state, and some 120 modes of its start: a Jacobian of two blocks of columns.
FIELD = (
    "system.axes.x.points=2048",
    "system.spread={u: 10%, length: 0.12}",
    "recording.duration=2",
    "recording.sensors=8",
    "simulation={members: 8, held_out: 2}",
    "budget=3600",
)
# Terms in windows are fitted side by side.
TWIN = """
a:
  terms: [{equation: u, term: u, coefficient: -0.8, window: {x: [1, 3], edge: 0.3}}]
"""


@pytest.fixture
def as_large(monkeypatch: pytest.MonkeyPatch) -> None:
    """Treat analyses of seconds as large."""
    monkeypatch.setattr(column_blocks, "LARGE", 1e6)
    monkeypatch.setattr(members, "WORTHWHILE", 0)


@pytest.mark.slow
def test_the_findings_of_a_cluster_are_those_of_this_machine(
    quick: Path, train: Run, as_large: None, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    pytest.importorskip("distributed")
    conf = tmp_path / "windowed.yaml"
    shutil.copy(quick, conf)
    (tmp_path / "twins").mkdir()
    (tmp_path / "twins" / conf.name).write_text(TWIN)
    alone = train(f"conf={conf}", *FIELD, folder=tmp_path / "alone")
    assert alone.code == 0, alone.err
    words = [f"conf={conf}", *FIELD, f"recording.path={alone.output / 'recording.nc'}"]
    called: list[str] = []
    call = ClusterCalls.call_with

    def counted(calls, things, function, *args):
        called.append(function.__qualname__)
        return call(calls, things, function, *args)

    def until_lost(calls, things, function, *args):
        if len(called) == 20:
            raise NotAnsweredError("the scheduler is lost", where=WHERE)
        return counted(calls, things, function, *args)

    monkeypatch.setattr(ClusterCalls, "call_with", until_lost)
    lost = train(*words, "cluster=2", folder=tmp_path / "lost")
    assert lost.code == WRONG_INPUT
    assert lost.err.strip().splitlines()[-1] == "error: cluster=: the scheduler is lost"
    assert not (lost.output / "findings.json").exists()

    monkeypatch.setattr(ClusterCalls, "call_with", counted)
    resumed = train(*words, "cluster=2", folder=tmp_path / "lost")
    assert resumed.code == 0, resumed.err
    assert "read from its checkpoint" in resumed.out
    assert set(called) == {"MemberSimulator.run", "columns_on_worker", "fit_on_worker"}
    assert laws(resumed) == laws(alone)
    assert resumed.read("findings.json") == alone.read("findings.json")


def laws(run: Ended) -> object:
    """Return the laws with their coefficients, whose difference is easy to read."""
    findings = json.loads(run.read("findings.json"))
    return findings["verdict"], findings["terms"], findings["alternatives"]
