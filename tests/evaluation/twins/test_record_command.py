"""The recorder writes noisy readings of the truth."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
import pytest
import xarray as xr

from dashred.config import load_config
from dashred.core.errors import InputError
from dashred.data.io.reader import read_recording
from dashred.data.observation_operator import ObservationOperator
from dashred.data.recording import Recording
from dashred.evaluation.twins import record_command
from dashred.physics.system import System


def recorded(quick: Path, folder: Path, *words: str) -> tuple[Recording, xr.Dataset, System]:
    assert record_command.main([f"conf={quick}", f"output={folder}", *words]) == 0
    config = load_config([f"conf={quick}"], entry="record")
    system = System(config.system, config.where)
    recording = read_recording(str(folder / "recording.nc"), None, system)
    with xr.open_dataset(folder / "sealed.nc", engine="h5netcdf") as sealed:
        return recording, sealed.load(), system


def noise(recording: Recording, sealed: xr.Dataset, system: System) -> np.ndarray:
    import torch

    states = torch.from_numpy(sealed["u"].values[: len(recording.times), None])
    return recording.values - ObservationOperator(recording.sensors, system)(states).numpy()


def test_the_sensors_read_the_truth_with_the_noise_asked_for(quick, tmp_path) -> None:
    words = ("twin=a", "recording.noise=0.1", "recording.every=0.02")
    recording, sealed, system = recorded(quick, tmp_path, *words)
    left = noise(recording, sealed, system)
    whole = sealed["u"].values[: len(recording.times)].std()
    assert left.std() == pytest.approx(0.1 * whole, rel=0.1)
    assert np.abs(np.corrcoef(left.T) - np.eye(6)).max() < 0.35
    assert [sensor.std for sensor in recording.sensors] == pytest.approx(
        [0.1 * whole] * 6, rel=1e-3
    )


def test_without_noise_the_sensors_read_the_truth_itself(quick, tmp_path) -> None:
    recording, sealed, system = recorded(quick, tmp_path, "recording.noise=0")
    assert np.abs(noise(recording, sealed, system)).max() < 1e-12
    assert [sensor.std for sensor in recording.sensors] == [None] * 6


def test_validation_and_test_sensors_come_on_top(quick, tmp_path) -> None:
    words = ("recording.sensors=7", "splits.sensors.validate=2", "splits.sensors.test=3")
    recording, _, system = recorded(quick, tmp_path, *words)
    assert len(recording.sensors) == 12
    assert all(sensor.reads == "u" for sensor in recording.sensors)
    places = sorted(sensor.position[0] for sensor in recording.sensors)
    assert places[0] >= 0 and places[-1] < system.axes[0].length
    assert min(np.diff(places)) > 0.05


def test_the_truth_extends_past_the_recording_for_forecasts(quick, tmp_path) -> None:
    recording, sealed, _ = recorded(quick, tmp_path)
    assert recording.times[[0, -1]] == pytest.approx([0, 4])
    assert sealed["time"].values[-1] == pytest.approx(6)
    assert sealed.attrs["twin"] == "a" and sealed.attrs["duration"] == 4
    assert json.loads(sealed.attrs["terms"]) == [
        {"equation": "u", "term": "u", "coefficient": -0.1, "window": None}
    ]
    # Damped by exp(-0.1 t), and nothing else moves the mean.
    mean = sealed["u"].values.mean(axis=1)
    assert mean[-1] / mean[0] == pytest.approx(np.exp(-0.6), rel=1e-6)


WINDOWS = """
a: {terms: [{equation: u, term: u, coefficient: -0.5, window: WINDOW}]}
"""


@pytest.mark.parametrize(
    ("window", "sealed"),
    [
        ("{x: [1, 2.5], edge: 0.2}", ["x", 1.0, 2.5, 0.2]),
        ("{t: [2, null], edge: 0.1}", ["t", 2.0, None, 0.1]),
        ("{u: [null, 1], edge: 0.1}", ["u", None, 1.0, 0.1]),
    ],
)
def test_a_term_may_act_in_a_window_alone(quick, tmp_path, window, sealed) -> None:
    (tmp_path / "twins").mkdir()
    (tmp_path / "twins" / "quick.yaml").write_text(WINDOWS.replace("WINDOW", window))
    copied = tmp_path / "quick.yaml"
    copied.write_text(quick.read_text())
    _, truth, _ = recorded(copied, tmp_path)
    [term] = json.loads(truth.attrs["terms"])
    assert term["window"] == sealed
    states, times = truth["u"].values, truth["time"].values
    mean = states.mean(axis=1)
    if sealed[0] == "t":
        # Nothing moves the mean before, and then it is damped.
        assert mean[times < 1.6].std() < 1e-3 * mean[0]
        assert mean[-1] / mean[0] == pytest.approx(np.exp(-0.5 * (times[-1] - 2.0)), rel=0.02)
    else:
        assert np.exp(-0.5 * times[-1]) < mean[-1] / mean[0] < 0.99


@pytest.mark.parametrize(
    ("window", "problem"),
    [
        ("{y: [1, 2], edge: 0.2}", "needs bounds of one axis, field or t"),
        ("{x: [1, 2]}", "needs bounds of one axis, field or t"),
        ("{x: [1, null], edge: 0.2}", "for a field or t, one of them must be null"),
        ("{u: [0, 1], edge: 0.2}", "for a field or t, one of them must be null"),
        ("{t: [null, 2], edge: 0.2}", "needs a start time"),
        ("{x: 3, edge: 0.2}", r"needs \[from, to\]"),
    ],
)
def test_a_wrong_window_is_refused(quick, tmp_path, window, problem) -> None:
    (tmp_path / "twins").mkdir()
    (tmp_path / "twins" / "quick.yaml").write_text(WINDOWS.replace("WINDOW", window))
    copied = tmp_path / "quick.yaml"
    copied.write_text(quick.read_text())
    with pytest.raises(InputError, match=problem):
        recorded(copied, tmp_path)


CONCEALED = """
a:
  terms: []
  parameters: {nu: 0.3}
  faults: [FAULT]
  spread: 3
  correlation: 0.6
"""


@pytest.mark.parametrize(
    ("kind", "value"),
    [("bias", 0.5), ("drift", 0.2), ("stuck", 2.0), ("spikes", 2.0), ("misplaced", 0.4)],
)
def test_sensors_may_be_faulty_and_all_of_it_is_sealed(quick, tmp_path, kind, value) -> None:
    (tmp_path / "twins").mkdir()
    copied = tmp_path / "quick.yaml"
    copied.write_text(quick.read_text())
    found = {}
    for name in ("sound", kind):
        fault = f"{{sensor: s3, kind: {name}, value: {value}}}" if name == kind else ""
        (tmp_path / "twins" / "quick.yaml").write_text(CONCEALED.replace("FAULT", fault))
        recording, sealed, system = recorded(copied, tmp_path, "recording.noise=0")
        found[name] = noise(recording, sealed, system)
        hidden = json.loads(sealed.attrs["concealed"])
        assert hidden["parameters"] == {"nu": 0.3}
        assert (hidden["spread"], hidden["correlation"]) == (3.0, 0.6)
    assert hidden["faults"] == [{"sensor": "s3", "kind": kind, "value": value}]
    column = [s.name for s in recording.sensors].index("s3")
    off, times = found[kind][:, column], recording.times
    assert np.abs(np.delete(found[kind], column, axis=1)).max() < 1e-9
    if kind == "bias":
        np.testing.assert_allclose(off, 0.5, atol=1e-9)
    elif kind == "drift":
        np.testing.assert_allclose(off, 0.2 * times, atol=1e-9)
    elif kind == "stuck":
        assert np.abs(off[times < 2.0]).max() < 1e-9
        assert np.ptp(recording.values[times >= 2.0, column]) == 0.0
    elif kind == "spikes":
        assert 5 < (np.abs(off - 2.0) < 1e-9).sum() < 9
    else:
        assert np.abs(off).max() > 0.01
    assert np.abs(found["sound"]).max() < 1e-9


def test_noise_can_be_autocorrelated(quick, tmp_path) -> None:
    (tmp_path / "twins").mkdir()
    (tmp_path / "twins" / "quick.yaml").write_text(CONCEALED.replace("FAULT", ""))
    copied = tmp_path / "quick.yaml"
    copied.write_text(quick.read_text())
    rest = noise(*recorded(copied, tmp_path, "recording.noise=0.1", "recording.duration=60"))
    before, after = rest[:-1].ravel(), rest[1:].ravel()
    assert np.corrcoef(before, after)[0, 1] == pytest.approx(0.6, abs=0.05)


@pytest.mark.parametrize(
    ("text", "problem"),
    [
        ("parameters: {mu: 1}", "true values by name"),
        ("faults: [{sensor: s1, kind: broken, value: 1}]", "a fault needs a sensor"),
        ("faults: [{sensor: s1, kind: bias}]", "a fault needs a sensor"),
        ("correlation: 1.0", "at least 0 and below 1"),
        ("sensors: 3", "may have"),
    ],
)
def test_a_malformed_twin_is_refused(quick, tmp_path, text, problem) -> None:
    (tmp_path / "twins").mkdir()
    (tmp_path / "twins" / "quick.yaml").write_text(f"a: {{terms: [], {text}}}\n")
    copied = tmp_path / "quick.yaml"
    copied.write_text(quick.read_text())
    with pytest.raises(InputError, match=problem):
        recorded(copied, tmp_path)


def test_the_recording_says_nothing_of_the_truth(quick, tmp_path) -> None:
    recorded(quick, tmp_path, "twin=b")
    with xr.open_dataset(tmp_path / "recording.nc", engine="h5netcdf") as dataset:
        assert dataset.attrs.keys() == {"Conventions", "featureType"}
        assert {*dataset.variables} == {"value", "time", "name", "reads", "std", "x"}
    assert b"u**3" not in (tmp_path / "recording.nc").read_bytes()
    assert {path.name for path in tmp_path.iterdir()} == {"recording.nc", "sealed.nc"}


def test_the_same_seed_records_the_same_and_another_does_not(quick, tmp_path) -> None:
    names = ("one", "two", "three")
    seeds = ("seed=1", "seed=1", "seed=2")
    runs = [recorded(quick, tmp_path / n, s)[0] for n, s in zip(names, seeds, strict=True)]
    assert runs[0].sha256() == runs[1].sha256() != runs[2].sha256()
    first, other = (sorted(s.position for s in r.sensors) for r in (runs[0], runs[2]))
    assert first != other


def twin_of(folder: Path, quick: Path, entry: str) -> Path:
    (folder / "twins").mkdir(parents=True)
    (folder / "mine.yaml").write_text(quick.read_text())
    (folder / "twins" / "mine.yaml").write_text(f"a: {entry}\n")
    return folder / "mine.yaml"


def test_misstated_noise_is_hidden(quick, tmp_path) -> None:
    path = twin_of(tmp_path, quick, "{terms: [], stated: 1.5}")
    recording, sealed, system = recorded(path, tmp_path / "out", "recording.every=0.02")
    stated = recording.sensors[0].std
    assert stated is not None
    assert noise(recording, sealed, system).std() == pytest.approx(stated / 1.5, rel=0.1)


def test_a_truth_may_be_spun_up_under_its_own_law(quick, tmp_path) -> None:
    law = "terms: [{equation: u, term: u, coefficient: -0.5}]"
    means = {}
    for start in ("simulator", "own"):
        path = twin_of(tmp_path / start, quick, f"{{{law}, start: {start}}}")
        words = ("system.spin_up=2", "system.spread.u=0")
        _, sealed, _ = recorded(path, tmp_path / start / "out", *words)
        means[start] = sealed["u"].values[0].mean()
    assert means["simulator"] == pytest.approx(1, rel=1e-6)
    assert means["own"] == pytest.approx(np.exp(-1), rel=1e-6)


def test_an_ode_has_no_places_and_its_sensors_take_turns(tmp_path) -> None:
    path = tmp_path / "swing.yaml"
    path.write_text(
        "system:\n  title: Swing\n  fields: {a: angle, w: speed}\n"
        "  equations: {a: w, w: -sin(a)}\n  start: {a: 1, w: 0}\n  spread: {a: 0.1}\n"
        "  parameters: {}\n  integrator: {method: rk4, dt: 0.05}\n"
        "recording: {twin: a, sensors: 3, duration: 3, every: 0.1, reads: [a, w]}\nthreads: 1\n"
    )
    (tmp_path / "twins").mkdir()
    (tmp_path / "twins" / "swing.yaml").write_text("a: {terms: []}\n")
    recording, _, _ = recorded(path, tmp_path / "out")
    assert [(s.reads, s.position) for s in recording.sensors] == [("a", ()), ("w", ()), ("a", ())]


def test_an_output_folder_is_required(quick) -> None:
    with pytest.raises(InputError, match="output=DIR"):
        record_command.main([f"conf={quick}", "twin=a"])


def test_a_table_of_sensors_is_for_recordings_of_ones_own(quick, tmp_path) -> None:
    with pytest.raises(InputError, match="must be a number of sensors"):
        record_command.main(
            [f"conf={quick}", "recording.sensors=mine.csv", f"output={tmp_path / 'out'}"]
        )
    assert not (tmp_path / "out").exists()
