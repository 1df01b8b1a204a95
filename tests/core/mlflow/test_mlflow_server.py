"""A tracking server as a real process, with a complete run and a real browser."""

from __future__ import annotations

import json
import os
import re
import shutil
import signal
import subprocess
import sys
from collections.abc import Iterator
from contextlib import suppress
from pathlib import Path
from typing import Any
from urllib.parse import quote, urlencode

import numpy as np
import pytest

from dashred.core.errors import InputError
from dashred.core.mlflow.tracker import Tracker
from dashred.pipeline.run.run_manifest import read_pointer
from tests.conftest import CHECKOUT, Ended
from tests.documents import snippets
from tests.support.killing import kill_when, start
from tests.support.servers import free_ports, wait_for_health

BROWSERS = ("chromium", "chromium-browser", "google-chrome")
CHROMIUM = next(filter(None, map(shutil.which, BROWSERS)), None)
QUIET = "no-sandbox disable-gpu disable-quic no-first-run disable-background-networking"
FLAGS = [f"--{flag}" for flag in (*QUIET.split(), "headless", "disable-component-update")]


@pytest.fixture(scope="module")
def server(tmp_path_factory: pytest.TempPathFactory) -> Iterator[str]:
    """Start an ``mlflow server`` with its own store and artifacts; yield its URL."""
    folder, port = tmp_path_factory.mktemp("server"), free_ports(1)[0]
    command = [sys.executable, "-m", "mlflow", "server", "--host", "127.0.0.1", "--workers", "1"]
    command += ["--port", str(port), "--backend-store-uri", f"sqlite:///{folder / 'mlflow.db'}"]
    command += ["--artifacts-destination", str(folder / "artifacts")]
    with (folder / "log").open("wb") as log:
        process = subprocess.Popen(
            command, cwd=folder, stdout=log, stderr=log, start_new_session=True
        )
        try:
            wait_for_health(f"http://127.0.0.1:{port}", process)
            yield f"http://127.0.0.1:{port}"
        finally:
            with suppress(ProcessLookupError):
                os.killpg(process.pid, 15)
            process.wait()


@pytest.fixture(scope="module")
def sent(server: str, quick: Path, tmp_path_factory: pytest.TempPathFactory) -> str:
    """Run a twin experiment on the server, with its model; return the id of the run."""
    output = tmp_path_factory.mktemp("sent") / "output"
    words = [f"conf={quick}", f"output={output}", f"tracking.root={server}", "tracking.model=true"]
    ended = subprocess.run(
        [sys.executable, "-m", "dashred.train", *words], capture_output=True, text=True
    )
    assert ended.returncode == 0, ended.stderr
    return str(json.loads((output / "run.json").read_text())["mlflow_run"])


def client_of(server: str) -> Any:
    from mlflow import MlflowClient

    return MlflowClient(tracking_uri=server)


@pytest.mark.slow
def test_a_whole_run_is_on_the_server_with_its_artifacts(server: str, sent: str) -> None:
    client = client_of(server)
    run = client.get_run(sent)
    assert run.info.status == "FINISHED"
    assert run.info.run_name.startswith(f"quick seed 0: {run.data.tags['verdict']}")
    assert run.data.tags["twin"] == "a"
    assert run.data.tags["mlflow.note.content"].startswith("**Verdict: ")
    kept = {file.path for file in client.list_artifacts(sent)}
    assert {"findings.json", "report.html", "corrected.yaml", "space_time.png"} <= kept
    assert "checkpoints" not in kept


@pytest.mark.slow
@pytest.mark.parametrize("point", ["assimilate", "train corrected"])
def test_a_killed_run_is_resumed_in_the_same_run_on_the_server(
    point: str, server: str, quick: Path, twin_run: Ended, tmp_path: Path
) -> None:
    output, store = tmp_path / "output", f"tracking.root={server}"
    recording = f"recording.path={twin_run.output / 'recording.nc'}"
    process = start([f"conf={quick}", recording, f"output={output}", store])
    kill_when(process, lambda printed: any(point in line for line in printed))
    assert process.returncode == -signal.SIGKILL and not (output / "run.json").exists()
    run_id = read_pointer(output)
    assert client_of(server).get_run(run_id).info.status == "RUNNING"

    again = start([f"resume={run_id}", f"output={output}", store])
    told, _ = again.communicate()
    assert again.returncode == 0, told
    assert (output / "findings.json").read_bytes() == twin_run.read("findings.json")
    assert client_of(server).get_run(run_id).info.status == "FINISHED"
    kept = client_of(server).download_artifacts(run_id, "findings.json", str(tmp_path))
    assert Path(kept).read_bytes() == twin_run.read("findings.json")


@pytest.mark.slow
def test_the_surrogate_loads_without_dashred(server: str, sent: str, tmp_path: Path) -> None:
    """The model is loaded from the server in a process without dashred on its path."""
    [logged] = client_of(server).search_logged_models(
        [client_of(server).get_run(sent).info.experiment_id]
    )
    assert logged.name == "corrected_shred" and logged.source_run_id == sent
    program = f"""
import sys, numpy as np, mlflow
sys.meta_path[:] = [f for f in sys.meta_path if "__editable__" not in getattr(f, "__module__", "")]
mlflow.set_tracking_uri({server!r})
info = mlflow.models.get_model_info("runs:/{sent}/corrected_shred")
model = mlflow.pytorch.load_model("runs:/{sent}/corrected_shred")
example = info.load_input_example() if hasattr(info, "load_input_example") else None
import torch
shape = [abs(n) for n in info.signature.inputs.inputs[0].shape]
field = model(torch.zeros(5, *shape[1:]))
assert "dashred" not in sys.modules
np.save({str(tmp_path / "shape.npy")!r}, np.array([*field.shape, *shape]))
"""
    ended = subprocess.run(
        [sys.executable, "-c", program], cwd=tmp_path, capture_output=True, text=True
    )
    assert ended.returncode == 0, ended.stderr
    batch, fields, points, _, lags, sensors = np.load(tmp_path / "shape.npy")
    assert (batch, fields, points) == (5, 1, 32)
    assert (lags, sensors) == (6, 3)


@pytest.mark.slow
def test_the_documented_program_estimates_a_field(server: str, sent: str) -> None:
    [text] = snippets(CHECKOUT / "docs/mlflow.md", "python")
    for shown, here in (
        ("sqlite:////absolute/DIR/mlflow.db", server),
        ("RUN_ID", sent),
        ("25, 8", "6, 3"),
    ):
        assert shown in text
        text = text.replace(shown, here)
    ended = subprocess.run(
        [sys.executable, "-c", f"{text}\nprint(tuple(field.shape))"], capture_output=True, text=True
    )
    assert ended.stdout.splitlines()[-1:] == ["(1, 1, 32)"], ended.stderr


@pytest.mark.slow
@pytest.mark.skipif(CHROMIUM is None, reason="chromium is not installed")
def test_a_browser_shows_the_run_and_its_artifacts(server: str, sent: str, tmp_path: Path) -> None:
    experiment = client_of(server).get_run(sent).info.experiment_id
    runs = seen(f"{server}/#/experiments/{experiment}/runs", tmp_path / "runs")
    assert "quick seed 0: " in runs
    page = seen(f"{server}/#/experiments/{experiment}/runs/{sent}/artifacts", tmp_path / "page")
    assert "report.html" in page and "findings.json" in page


@pytest.mark.slow
@pytest.mark.skipif(CHROMIUM is None, reason="chromium is not installed")
def test_a_browser_draws_a_curve_through_every_epoch(
    server: str, sent: str, tmp_path: Path
) -> None:
    client, name = client_of(server), "shred/rmse/field_members"
    history = client.get_metric_history(sent, name)
    experiment = client.get_run(sent).info.experiment_id
    asked = {
        "runs": json.dumps([sent]),
        "experiments": json.dumps([experiment]),
        "metric": json.dumps(name),
        "plot_metric_keys": json.dumps([name]),
        "plot_layout": "{}",
        "x_axis": "step",
        "y_axis_scale": "linear",
        "line_smoothness": "1",
        "deselected_curves": "[]",
        "last_linear_y_axis_range": "[]",
    }
    query = urlencode(asked, quote_via=quote)
    page = seen(f"{server}/#/metric?{query}", tmp_path / "curve")
    curves = re.findall(r'<path class="js-line"[^>]* d="M([^"]*)"', page)
    assert len(history) > 2
    assert {len(curve.split("L")) for curve in curves} == {len(history)}


def seen(url: str, profile: Path) -> str:
    """Return a page as rendered by the browser after its scripts have run."""
    assert CHROMIUM is not None
    own = [f"--user-data-dir={profile}", "--virtual-time-budget=30000", "--dump-dom"]
    ended = subprocess.run(
        [CHROMIUM, *FLAGS, *own, url], capture_output=True, text=True, timeout=120
    )
    return ended.stdout


def test_a_server_that_does_not_answer_is_named() -> None:
    url = f"http://127.0.0.1:{free_ports(1)[0]}"
    with (
        pytest.raises(InputError, match="no MLflow server responds") as caught,
        Tracker.open(url, "rde", "a run"),
    ):
        pass
    assert caught.value.where == url
