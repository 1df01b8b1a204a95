"""Download of the real pendulum's recording, from a local server."""

from __future__ import annotations

import io
import subprocess
import sys
import threading
from collections.abc import Iterator
from functools import partial
from http.server import BaseHTTPRequestHandler, SimpleHTTPRequestHandler, ThreadingHTTPServer
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from scipy.io import savemat

from dashred.core.errors import InputError
from dashred.data.io.fetch import main
from dashred.data.io.published_recording import PENDULUM, fetch_csv

CHECKOUT = Path(__file__).resolve().parents[3]
SHARED = CHECKOUT.parent / "shared" / "data"
NAME = "pendulum_single/recording.csv"
needs_data = pytest.mark.skipif(
    not (SHARED / NAME).is_file(), reason=f"{SHARED / NAME} is not there"
)


class Quiet(SimpleHTTPRequestHandler):
    """A server for a folder."""

    def log_message(self, *_: object) -> None:
        """Log nothing."""


class Breaking(BaseHTTPRequestHandler):
    """A server that sends less than it has announced."""

    def do_GET(self) -> None:
        """Send the beginning of a response."""
        self.send_response(200)
        self.send_header("Content-Length", "1000")
        self.end_headers()
        self.wfile.write(b"time,theta,omega\n")

    def log_message(self, *_: object) -> None:
        """Log nothing."""


def serve(handler) -> Iterator[str]:
    with ThreadingHTTPServer(("127.0.0.1", 0), handler) as server:
        thread = threading.Thread(target=server.serve_forever, kwargs={"poll_interval": 0.05})
        thread.start()
        yield f"http://127.0.0.1:{server.server_port}"
        server.shutdown()
        thread.join()


@pytest.fixture
def shared() -> Iterator[str]:
    yield from serve(partial(Quiet, directory=str(SHARED)))


@pytest.fixture
def breaking() -> Iterator[str]:
    yield from serve(Breaking)


def matlab(recording: Path) -> bytes:
    """Return a file like the authors': six segments in two cell arrays."""
    rows = np.loadtxt(recording, delimiter=",", skiprows=1) + np.array([0.0, np.pi, 0.0])
    length = len(rows) // 6 + 1
    pieces = [rows[i : i + length] for i in range(0, len(rows), length)]
    assert len(pieces) == 6
    cells: dict[str, Any] = {"dt": 0.001}
    for name, some in (("id", pieces[:4]), ("vad", pieces[4:])):
        states, times = (np.empty((len(some), 1), dtype=object) for _ in range(2))
        for i, piece in enumerate(some):
            states[i, 0], times[i, 0] = piece[:, 1:].T, piece[:, :1]
        cells |= {f"Y_{name}": states, f"Time_{name}": times}
    file: Any = io.BytesIO()
    savemat(file, cells, do_compression=True)
    return file.getvalue()


@needs_data
def test_it_is_fetched_checked_and_kept(shared, tmp_path, capsys) -> None:
    path = tmp_path / "data" / "pendulum.csv"
    assert main([f"path={path}", f"source={shared}/{NAME}"]) == 0
    assert path.read_bytes() == (SHARED / NAME).read_bytes()
    assert [found.name for found in path.parent.iterdir()] == ["pendulum.csv"]
    out = capsys.readouterr().out
    assert "MIT" in out and f"recording.path={path}" in out


@needs_data
def test_what_is_there_is_not_fetched_again(tmp_path, capsys) -> None:
    path = tmp_path / "pendulum.csv"
    path.write_bytes((SHARED / NAME).read_bytes())
    assert main([f"path={path}", "source=http://127.0.0.1:9/nobody-listens"]) == 0
    assert capsys.readouterr().out.startswith(f"already exists: {path}")


@needs_data
def test_the_authors_file_becomes_the_known_recording(tmp_path) -> None:
    source = tmp_path / "SinglePendulumDataForParameterEstimation.mat"
    source.write_bytes(matlab(SHARED / NAME))
    assert fetch_csv(PENDULUM, str(source)) == (SHARED / NAME).read_text()


def test_another_file_is_not_overwritten(tmp_path) -> None:
    path = tmp_path / "mine.csv"
    path.write_text("time,theta\n")
    with pytest.raises(InputError, match="is not this recording"):
        main([f"path={path}"])
    assert path.read_text() == "time,theta\n"


@pytest.mark.parametrize(
    ("source", "said"),
    [
        ("http://127.0.0.1:9/x", "cannot be reached"),
        ("http://127.0.0.1:99999/x", "cannot be"),
        ("ftp://127.0.0.1/x", "only http and https"),
        ("file:///etc/hostname", "only http and https"),
        ("nowhere.mat", "cannot read the file"),
    ],
)
def test_without_a_source_nothing_is_written(source: str, said: str, tmp_path) -> None:
    with pytest.raises(InputError, match=said):
        main([f"path={tmp_path / 'pendulum.csv'}", f"source={source}"])
    assert not list(tmp_path.iterdir())


def test_a_missing_page_is_reported_with_the_status_of_the_server(shared, tmp_path) -> None:
    with pytest.raises(InputError, match="404"):
        main([f"path={tmp_path / 'pendulum.csv'}", f"source={shared}/nothing.csv"])
    assert not list(tmp_path.iterdir())


def test_what_was_cut_short_is_not_kept(breaking, tmp_path) -> None:
    with pytest.raises(InputError, match=r"cut short|cannot be downloaded"):
        main([f"path={tmp_path / 'pendulum.csv'}", f"source={breaking}/recording.csv"])
    assert not list(tmp_path.iterdir())


def test_a_broken_matlab_file_is_refused(tmp_path) -> None:
    source = tmp_path / "broken.mat"
    source.write_bytes(b"MATLAB 5.0 MAT-file".ljust(128) + bytes(range(256)) * 4)
    with pytest.raises(InputError, match="not the authors' MATLAB file"):
        fetch_csv(PENDULUM, str(source))


@pytest.mark.parametrize(
    "words",
    [[], ["pendulum.csv"], ["path="], ["paht=a.csv"], ["path=a.csv", "path=b.csv"]],
)
def test_wrong_words_are_refused(words: list[str]) -> None:
    with pytest.raises(InputError):
        main(words)


@needs_data
def test_a_folder_that_cannot_be_created_is_reported(tmp_path) -> None:
    (tmp_path / "file").write_text("")
    path = tmp_path / "file" / "pendulum.csv"
    with pytest.raises(InputError, match="cannot be written"):
        main([f"path={path}", f"source={SHARED / NAME}"])


def test_an_error_is_a_message_and_code_2(tmp_path) -> None:
    words = [f"path={tmp_path / 'pendulum.csv'}", "source=http://127.0.0.1:9/x"]
    command = [sys.executable, "-m", "dashred", "fetch", *words]
    ended = subprocess.run(command, cwd=CHECKOUT, capture_output=True, text=True)
    assert ended.returncode == 2
    assert "Traceback" not in ended.stderr and "source=FILE" in ended.stderr
