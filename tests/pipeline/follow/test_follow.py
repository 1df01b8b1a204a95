"""``dashred follow`` from the command line: what is written, what is said, and what is refused."""

from __future__ import annotations

import json
import os
import signal
import subprocess
import sys
import time
from pathlib import Path

import numpy as np
import pandas as pd
import pytest
import torch
import xarray as xr

from dashred.core.command_line.entry import run_entry
from dashred.core.errors import InputError
from dashred.data.io.reader import read_episodes
from dashred.models.lag_windows import windows
from dashred.models.shred import reconstruct
from dashred.pipeline.follow import command
from tests.conftest import CHECKOUT
from tests.support import finished, streams

SECONDS = 300.0


@pytest.fixture(scope="module")
def run(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return finished.finished_run(tmp_path_factory.mktemp("finished") / "run")


def stream(samples: int, seed: int = 3, begin: float = 0.0) -> tuple[np.ndarray, np.ndarray]:
    times, values = streams.readings(samples, seed)
    return times + begin, values


def test_a_stream_gives_a_row_for_every_sample(run: Path, tmp_path: Path, capfd) -> None:
    times, values = stream(150)
    values[60, 0] = np.nan
    path = finished.write_stream(tmp_path / "s.csv", times, values)
    out, fields = tmp_path / "o.csv", tmp_path / "f.nc"
    words = [f"run={run}", f"source={path}", f"output={out}", f"fields={fields}", "every=50"]
    assert command.main([*words, "idle=0", "ahead=5"]) == 0
    table = pd.read_csv(out)
    assert table["time"].tolist() == pytest.approx(times.tolist())
    assert table["flag"].isna().sum() > 100 and table["alarm"].isna().all()
    assert np.isnan(table["place.innovation"][60]) and not np.isnan(table["place.filter"][60])
    # The estimate is better than the readings, and its spread says how good.
    truth = streams.readings(150, seed=3)[1] - noise(150, 3)
    error = table["place.filter"][50:] - truth[50:, 0]
    assert error.std() < 0.5 * streams.SIGMA
    assert (error.abs() < 4 * table["place.spread"][50:]).all()
    ahead = table["place.forecast"][50:-5].to_numpy() - truth[55:, 0]
    assert np.abs(ahead).max() < 2 * streams.SIGMA
    # SHRED reads the stream in blocks, with the same estimates as in the run.
    traces = torch.from_numpy(values)
    traces[60, 0] = table["place.filter"][60]
    network = finished.shred()
    whole = reconstruct(network.encode, network, windows(traces, finished.LAGS).float())
    assert table["momentum.shred"].to_numpy() == pytest.approx(whole[:, 1].numpy(), rel=1e-4)
    with xr.open_dataset(fields, engine="h5netcdf") as saved:
        assert saved["time"].to_numpy() == pytest.approx(times[[49, 99, 149]])
        at = saved["x"].sel({"method": "filter"}).to_numpy()
    assert at == pytest.approx(table["place.filter"][[49, 99, 149]].to_numpy(), rel=1e-5)
    said = capfd.readouterr().err
    assert "chosen on the recording" in said and "150 samples, 0 alarms" in said


def noise(samples: int, seed: int) -> np.ndarray:
    """Return the noise of :func:`tests.support.streams.readings`."""
    return streams.SIGMA * np.random.default_rng(seed).standard_normal((samples, 2))


@pytest.mark.parametrize(
    ("words", "told"),
    [
        ([], "observer: error of the simulator in a sample 0.001"),
        (["members=12"], "filter: 12 members"),
    ],
)
def test_an_ensemble_filter_is_used_if_it_is_asked_for(
    run: Path, tmp_path: Path, capfd, words: list[str], told: str
) -> None:
    path = finished.write_stream(tmp_path / "s.csv", *stream(30))
    known = [f"run={run}", f"source={path}", f"output={tmp_path / 'o.csv'}", "idle=0"]
    assert command.main([*known, *words]) == 0
    assert told in capfd.readouterr().err


def test_an_alarm_names_the_sensor_and_leaves_a_recording(
    run: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capfd
) -> None:
    # The stream comes in many blocks.
    monkeypatch.setattr("dashred.pipeline.follow.sources.text_streams.BLOCK", 1000)
    times, values = stream(400)
    values[200:, 1] += 0.03 * streams.SIGMA * np.arange(200)
    path = finished.write_stream(tmp_path / "s.csv", times, values)
    words = [f"run={run}", f"source={path}", f"output={tmp_path / 'o.jsonl'}", "idle=0"]
    assert command.main(words) == 0
    said = capfd.readouterr().err
    assert "momentum differs from what the other sensors say" in said
    assert "recording.path=" in said and "corrected.yaml" in said
    rows = [json.loads(line) for line in (tmp_path / "o.jsonl").read_text().splitlines()]
    assert len(rows) == 400
    assert rows[-1]["flag"] == "left-out:momentum" and rows[-1]["alarm"] == "momentum"
    window, table = tmp_path / "o-window-1.csv", tmp_path / "o-window-1-sensors.csv"
    found = read_episodes(str(window), str(table), streams.system()).single("window")
    assert found.times[-1] == pytest.approx(times[-1])
    assert times[195] < found.times[0] < times[260]
    assert found.names == ("place", "momentum")


def test_a_recording_of_another_system_is_flagged(run: Path, tmp_path: Path, capfd) -> None:
    times, values = stream(200)
    path = finished.write_stream(tmp_path / "s.csv", times, 7 * np.cos(3 * times)[:, None] + values)
    words = [f"run={run}", f"source={path}", f"output={tmp_path / 'o.csv'}", "idle=0"]
    assert command.main(words) == 0
    assert "another system" in capfd.readouterr().err
    assert pd.read_csv(tmp_path / "o.csv")["alarm"].notna().sum() > 100


def test_a_stream_without_the_sensors_is_refused(run: Path, tmp_path: Path) -> None:
    path = tmp_path / "s.csv"
    path.write_text("time,pressure,flow\n0,1,2\n0.1,1,2\n")
    with pytest.raises(InputError, match="none of the sensors"):
        command.main([f"run={run}", f"source={path}", f"output={tmp_path / 'o.csv'}", "idle=0"])


def test_a_disk_that_is_full_is_one_message(
    run: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capfd
) -> None:
    path = finished.write_stream(tmp_path / "s.csv", *stream(20))
    words = [f"run={run}", f"source={path}", "output=/dev/full", "idle=0"]
    monkeypatch.setattr(sys, "argv", ["dashred follow", *words])
    assert run_entry(command.main) == 1
    said = capfd.readouterr().err
    assert said.count("error:") == 1 and "No space left" in said and "/dev/full" in said


def test_what_exists_is_not_overwritten(run: Path, tmp_path: Path) -> None:
    path = finished.write_stream(tmp_path / "s.csv", *stream(20))
    with pytest.raises(InputError, match="exists already"):
        command.main([f"run={run}", f"source={path}", f"output={path}"])


@pytest.mark.parametrize("name", ["estimator.nc", "corrected.yaml"])
def test_a_damaged_run_is_refused(name: str, tmp_path: Path) -> None:
    run = finished.finished_run(tmp_path / "run")
    (run / name).write_bytes(b"other")
    with pytest.raises(InputError, match="changed after it was frozen"):
        command.main([f"run={run}", "source=-"])


@pytest.mark.slow
def test_the_surrogate_is_loaded_without_dashred(run: Path, tmp_path: Path) -> None:
    path, numbers = tmp_path / "s.pt2", tmp_path / "x.npy"
    assert command.main([f"run={run}", f"export={path}"]) == 0
    example = torch.randn((3, finished.LAGS + 1, 2))
    np.save(numbers, example.numpy())
    code = f"""
import json, sys, numpy, torch
extra = {{"dashred.json": ""}}
network = torch.export.load({str(path)!r}, extra_files=extra).module()
numpy.save({str(numbers)!r}, network(torch.from_numpy(numpy.load({str(numbers)!r}))).numpy())
assert "dashred" not in sys.modules
assert json.loads(extra["dashred.json"])["sensors"] == ["place", "momentum"]
"""
    subprocess.run([sys.executable, "-W", "ignore", "-c", code], check=True, cwd=tmp_path)
    with torch.no_grad():
        ours = finished.shred()(example).numpy()
    assert np.load(numbers) == pytest.approx(ours, abs=1e-5)


@pytest.mark.slow
def test_ctrl_c_ends_a_growing_file_with_whole_rows(run: Path, tmp_path: Path) -> None:
    times, values = stream(80)
    path = finished.write_stream(tmp_path / "s.csv", times[:40], values[:40])
    out = tmp_path / "o.csv"
    words = [f"run={run}", f"source={path}", f"output={out}"]
    process = subprocess.Popen(
        [sys.executable, "-m", "dashred", "follow", *words],
        cwd=CHECKOUT,
        stderr=subprocess.PIPE,
        text=True,
        env=os.environ,
    )
    wait_for(out, 41)
    rest = finished.write_stream(tmp_path / "rest.csv", times[40:], values[40:]).read_text()
    with path.open("a") as file:
        file.write(rest.partition("\n")[2])
    wait_for(out, 81)
    process.send_signal(signal.SIGINT)
    _, said = process.communicate(timeout=SECONDS)
    assert process.returncode == 0 and "80 samples" in said and "Traceback" not in said
    assert out.read_text().endswith("\n") and len(pd.read_csv(out)) == 80


def wait_for(path: Path, lines: int) -> None:
    end = time.monotonic() + SECONDS
    while time.monotonic() < end:
        if path.exists() and path.read_text().count("\n") >= lines:
            return
        time.sleep(0.1)
    pytest.fail(f"{path} did not get {lines} lines")
