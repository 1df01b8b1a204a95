"""A cluster is refused where it names none, or where its workers would have nothing to do."""

from __future__ import annotations

from pathlib import Path

import pytest

from dashred.config import config_sha256, load_config
from dashred.core.errors import InputError

FIELD = """\
system:
  title: Waves
  axes: {x: {length: 10, points: 64}}
  fields: {u: height}
  equations: {u: -u + 0.1*lap(u)}
  start: {u: sin(2*pi*x/10)}
  spread: {u: 0.1}
  integrator: {dt: 0.1}
recording: {twin: a, every: 0.1}
"""
ODE = """\
system:
  title: Decay
  fields: {u: height}
  equations: {u: -u}
  start: {u: 1}
  spread: {u: 0.1}
  integrator: {dt: 0.1}
recording: {twin: a, every: 0.1}
"""
NOTHING = "no part of this analysis runs on a cluster"


def write(folder: Path, text: str) -> str:
    (folder / "mine.yaml").write_text(text)
    return f"conf={folder / 'mine.yaml'}"


@pytest.mark.parametrize(
    ("text", "words", "what"),
    [
        (ODE, (), NOTHING),
        (FIELD, ("system.integrator={space: finite-difference, method: rk4, dt: 0.1}",), NOTHING),
        (FIELD, ("system.axes.x.ends={left: insulated, right: insulated}",), NOTHING),
        (FIELD, ("device=cuda",), "the workers of a cluster compute on CPUs"),
    ],
)
def test_a_cluster_without_work_is_refused(tmp_path, text, words, what) -> None:
    with pytest.raises(InputError, match=what):
        load_config([write(tmp_path, text), *words, "cluster=2"], entry="train")


def test_spectral_fields_may_have_a_cluster_which_changes_no_finding(tmp_path) -> None:
    conf = write(tmp_path, FIELD)
    plain, on_cluster = (
        load_config([conf, *words], entry="train") for words in ((), ("cluster=slurm:2",))
    )
    assert on_cluster.cluster == "slurm:2"
    assert config_sha256(plain) == config_sha256(on_cluster)
