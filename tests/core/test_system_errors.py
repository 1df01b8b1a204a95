"""System errors, such as a full disk or a locked database, give one message, no traceback."""

from __future__ import annotations

import errno
import os
import sqlite3
import subprocess
import sys
from collections.abc import Iterator
from pathlib import Path

import numpy as np
import pytest
from matplotlib.figure import Figure

from dashred.core.command_line.entry import run_entry
from dashred.core.errors import InputError
from dashred.core.files.atomic import atomic_file, copy_atomic, write_text_atomic
from dashred.core.mlflow.store import open_store
from dashred.core.system_errors import describe_system_error
from dashred.data.io.write_netcdf import write_netcdf
from dashred.data.recording import Recording
from dashred.data.sensors import Sensor
from dashred.pipeline.run.output_dir import clear_output, make_output
from dashred.reporting.figures.style import save_figure

CHECKOUT = Path(__file__).resolve().parents[2]
FULL = OSError(errno.ENOSPC, "No space left on device", "/out/findings.json")


def _raise(error: BaseException) -> int:
    raise error


def wrapped(inner: BaseException) -> BaseException:
    """Return the exception of a library that was caused by another exception."""
    try:
        raise RuntimeError("the store failed") from inner
    except RuntimeError as outer:
        return outer


@pytest.mark.parametrize(
    ("error", "says"),
    [
        (FULL, ("/out/findings.json", "No space left", "free some space")),
        (OSError(errno.EROFS, "x"), ("Read-only file system", "output=DIR")),
        (PermissionError(errno.EACCES, "x", "/mlruns"), ("/mlruns", "Permission denied")),
        (MemoryError(), ("not enough memory", "simulation.memory")),
        (
            RuntimeError("DefaultCPUAllocator: can't allocate memory: 8 bytes"),
            ("not enough memory",),
        ),
        (sqlite3.OperationalError("database is locked"), ("database is locked", "tracking.root")),
        (wrapped(sqlite3.OperationalError("database is locked")), ("database is locked",)),
        (wrapped(FULL), ("No space left",)),
        (ModuleNotFoundError("No module named 'numba'", name="numba"), ("numba", "make setup")),
    ],
)
def test_what_the_machine_refuses_is_told_in_two_lines(error, says, capsys) -> None:
    assert run_entry(lambda _: _raise(error)) == 1
    out, err = capsys.readouterr()
    assert out == "" and err.startswith("error: ") and len(err.splitlines()) == 2
    assert "Traceback" not in err
    for text in says:
        assert text in err


@pytest.mark.parametrize(
    "error",
    [
        ZeroDivisionError(),
        OSError(errno.ENOENT, "No such file"),
        RuntimeError("shapes do not match"),
        ImportError("cannot import name 'x'", name="dashred.train"),
    ],
)
def test_a_bug_is_not_described_as_a_system_error(error) -> None:
    assert describe_system_error(error) is None
    with pytest.raises(type(error)):
        run_entry(lambda _: _raise(error))


@pytest.mark.parametrize("entry", ["train", "record", "bench"])
def test_missing_packages_are_reported_with_a_hint(entry) -> None:
    """``-S`` leaves the installed packages out."""
    command = [sys.executable, "-S", "-m", "dashred", entry, "conf=rde"]
    ended = subprocess.run(command, cwd=CHECKOUT, capture_output=True, text=True)
    assert ended.returncode == 1
    assert ended.stderr.startswith("error: the package omegaconf cannot be imported")
    assert "make setup" in ended.stderr and "Traceback" not in ended.stderr


def test_what_was_there_stays_until_the_new_file_is_whole(tmp_path, monkeypatch) -> None:
    path = tmp_path / "findings.json"
    write_text_atomic(path, "old")
    monkeypatch.setattr("dashred.core.files.atomic.os.fsync", lambda _: _raise(FULL))
    with pytest.raises(OSError, match="No space"):
        write_text_atomic(path, "new")
    assert path.read_text() == "old"
    assert os.listdir(tmp_path) == ["findings.json"]


def test_what_may_not_be_read_is_no_matter_of_writing(tmp_path: Path, monkeypatch) -> None:
    path = tmp_path / "mine.yaml"
    path.touch()
    monkeypatch.setattr("os.access", lambda *_: False)
    said = describe_system_error(PermissionError(errno.EACCES, "Permission denied", str(path)))
    assert said is not None and "grant read permission" in said
    elsewhere = describe_system_error(
        PermissionError(errno.EACCES, "Permission denied", "/mlruns/new")
    )
    assert elsewhere is not None and "grant write permission" in elsewhere


def test_an_interruption_leaves_no_half_of_a_file(tmp_path) -> None:
    with pytest.raises(KeyboardInterrupt), atomic_file(tmp_path / "a.txt") as partial:
        partial.write_text("half")
        raise KeyboardInterrupt
    assert os.listdir(tmp_path) == []


def test_what_a_killed_run_had_not_finished_is_taken_away(tmp_path) -> None:
    for name in (".estimates.nc.77.partial", "findings.json", "mine.partial", "notes.txt"):
        (tmp_path / name).write_text("x")
    clear_output(tmp_path)
    assert sorted(os.listdir(tmp_path)) == ["mine.partial", "notes.txt"]


@pytest.fixture
def mounted(tmp_path: Path) -> Iterator[Path]:
    """A disk of 64 kB; skipped if mounting is not permitted."""
    folder = tmp_path / "disk"
    folder.mkdir()
    size = ["-o", "size=64k"]
    try:
        made = subprocess.run(["mount", "-t", "tmpfs", *size, "tmpfs", folder], capture_output=True)
    except FileNotFoundError:
        pytest.skip("there is no mount here")
    if made.returncode:
        pytest.skip("this user may not mount a disk")
    try:
        yield folder
    finally:
        subprocess.run(["umount", "-l", folder], check=True)


def recording() -> Recording:
    times = np.arange(20_000.0)
    return Recording((Sensor("a", "u"),), times, np.sin(times)[:, None])


def test_a_full_disk_leaves_what_was_there(mounted, tmp_path) -> None:
    """Covers all ways of writing: text, copy, NetCDF and figure."""
    large = tmp_path / "large"
    large.write_bytes(bytes(200_000))
    noise = np.random.default_rng(0).random((300, 300))
    figure = Figure()
    figure.add_subplot().imshow(noise)
    ways = [
        lambda path: write_text_atomic(path, "x" * 200_000),
        lambda path: copy_atomic(large, path),
        lambda path: write_netcdf(recording(), path),
        lambda path: save_figure(figure, path),
    ]
    (mounted / "a.out").write_text("old")
    for write in ways:
        with pytest.raises(OSError) as caught:
            write(mounted / "a.out")
        said = describe_system_error(caught.value)
        assert said is not None and "No space left" in said
        assert os.listdir(mounted) == ["a.out"]
        assert (mounted / "a.out").read_text() == "old"


def test_a_folder_that_is_only_read_is_refused_before_any_work(mounted) -> None:
    subprocess.run(["mount", "-o", "remount,ro", mounted], check=True)
    with pytest.raises(InputError, match="cannot be written to: Read-only") as caught:
        make_output(str(mounted))
    assert caught.value.where == str(mounted)
    with pytest.raises(InputError, match="cannot be created: Read-only"):
        make_output(str(mounted / "new"))
    with pytest.raises(InputError, match="no MLflow store can be created here: Read-only"):
        open_store(str(mounted), "any")


@pytest.mark.slow
def test_a_locked_store_is_reported(tmp_path) -> None:
    """MLflow gives up after twenty seconds."""
    root = str(tmp_path / "mlruns")
    open_store(root, "first")
    holder = sqlite3.connect(tmp_path / "mlruns" / "mlflow.db")
    holder.execute("begin exclusive")
    try:
        with pytest.raises(Exception) as caught:
            open_store(root, "second")
    finally:
        holder.close()
    assert isinstance(caught.value, InputError) or describe_system_error(caught.value)
    assert "database is locked" in f"{caught.value}{describe_system_error(caught.value)}"
