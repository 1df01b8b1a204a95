"""Streams of a system that measured inputs drive."""

from __future__ import annotations

import json
from pathlib import Path
from typing import cast

import numpy as np
import pandas as pd
import pytest

from dashred.data.io.reader import read_episodes
from dashred.pipeline.follow import command
from tests.support import driven, finished

BEGIN = 3.0


@pytest.fixture(scope="module")
def run(tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("driven") / "run"
    return finished.finished_run(folder, cast(finished.Example, driven))


def follow(run: Path, stream: Path, *words: str) -> pd.DataFrame:
    out = stream.with_name("o.csv")
    given = [f"run={run}", f"source={stream}", f"output={out}", "idle=0", *words]
    assert command.main(given) == 0
    return pd.read_csv(out)


def write(path: Path, columns: dict[str, np.ndarray]) -> Path:
    pd.DataFrame(columns).to_csv(path, index=False, float_format="%.12g")
    return path


def stream(samples: int, seed: int = 3) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Return times, readings and states, from a time within the recording on."""
    times, values = driven.readings(samples, seed, BEGIN)
    return times, values[:, 0], driven.states(samples, BEGIN)[1]


def test_the_estimate_follows_the_input(run: Path, tmp_path: Path, capfd) -> None:
    times, values, states = stream(300)
    columns = {"time": times, "place": values, "voltage": driven.voltage(times)}
    table = follow(run, write(tmp_path / "s.csv", columns), "ahead=1")
    assert "300 samples, 0 alarms" in capfd.readouterr().err
    assert table["flag"][100:].isna().all()
    late = slice(100, None)
    for name, of_field in {"place": 0, "p": 1}.items():
        error = table[f"{name}.filter"][late] - states[late, of_field]
        assert error.std() < 0.5 * driven.SIGMA
        assert (error.abs() < 4 * table[f"{name}.spread"][late]).all()
    # Nothing is known of the input ahead: a forecast holds its value.
    ahead = table["p.forecast"][100:-1].to_numpy()
    change = ahead - table["p.filter"][100:-1].to_numpy()
    x, p = (table[f"{name}.filter"][100:-1].to_numpy() for name in ("place", "p"))
    held = -x - 0.3 * p + driven.voltage(times[100:-1])
    np.testing.assert_allclose(change, driven.EVERY * held, atol=0.012)


@pytest.mark.parametrize(("every", "tolerance"), [(0.1, 1e-9), (0.05, 3e-3)])
def test_inputs_may_come_in_messages_of_their_own(
    run: Path, tmp_path: Path, every: float, tolerance: float
) -> None:
    times, values, _ = stream(60)
    own = BEGIN + every * np.arange(round(6.0 / every), dtype=np.float64)
    messages = [
        *({"time": t, "voltage": v} for t, v in zip(own, driven.voltage(own), strict=True)),
        *({"time": t, "place": v} for t, v in zip(times, values, strict=True)),
    ]
    # The sort keeps the order of equal times: the input comes before the reading.
    messages.sort(key=lambda message: round(message["time"], 6))
    path = tmp_path / "s.jsonl"
    path.write_text("".join(f"{json.dumps(message)}\n" for message in messages))
    found = follow(run, path)
    columns = {"time": times, "place": values, "voltage": driven.voltage(times)}
    (tmp_path / "again").mkdir()
    rows = follow(run, write(tmp_path / "again" / "s.csv", columns))
    # Straight lines between more samples are closer to the voltage: that changes the estimate.
    np.testing.assert_allclose(found["p.filter"], rows["p.filter"], rtol=0, atol=tolerance)
    assert not found["flag"].astype(str).str.contains("held").any()


def test_an_input_that_stops_is_held_and_flagged(run: Path, tmp_path: Path, capfd) -> None:
    times, values, _ = stream(120)
    voltage = driven.voltage(times)
    voltage[60:80] = np.nan
    columns = {"time": times, "place": values, "voltage": voltage}
    table = follow(run, write(tmp_path / "s.csv", columns))
    is_held = table["flag"].astype(str).str.contains("held:voltage")
    assert is_held[61:80].all() and is_held.sum() == 19 + is_held[60]
    assert capfd.readouterr().err.count("no sample of the input 'voltage'") == 1
    late = columns | {"voltage": driven.voltage(times)}
    late["time"], late["voltage"] = times, np.full(len(times), np.nan)
    (tmp_path / "none").mkdir()
    without = follow(run, write(tmp_path / "none" / "s.csv", late))
    assert without["flag"].astype(str).str.contains("held:voltage").all()


def test_the_window_of_an_alarm_has_the_inputs(run: Path, tmp_path: Path) -> None:
    times, values, _ = stream(300)
    values[200:] += 0.03 * driven.SIGMA * np.arange(100)
    columns = {"time": times, "place": values, "voltage": driven.voltage(times)}
    follow(run, write(tmp_path / "s.csv", columns))
    window, table = tmp_path / "o-window-1.csv", tmp_path / "o-window-1-sensors.csv"
    found = read_episodes(str(window), str(table), driven.system()).single("window")
    assert found.names == ("place",)
    expected = driven.voltage(found.inputs.times)
    np.testing.assert_allclose(found.inputs.values["voltage"], expected, rtol=1e-6)
