"""Any path given by the user is accepted, or refused in one sentence."""

from __future__ import annotations

import socket
import threading
from collections.abc import Callable
from pathlib import Path

import pytest

from dashred import train
from dashred.config import load_config, reference_command
from dashred.core.errors import InputError
from dashred.core.files.user_path import user_path
from dashred.core.mlflow.server import check_server
from dashred.data.io import fetch
from dashred.pipeline.init import command

LONG = "x" * 300
NOBODY = "~nobody-of-that-name/a"


def test_home_is_the_home_folder(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    monkeypatch.setenv("HOME", str(tmp_path))
    assert user_path("~/a.csv", "path=") == tmp_path / "a.csv"


@pytest.mark.parametrize("name", [LONG, NOBODY, "a\0b"])
@pytest.mark.parametrize(
    ("main", "word"),
    [
        (train.main, "conf={}.yaml"),
        (command.main, "path={}.csv"),
        (command.main, "sensors={}.csv"),
        (command.main, "output={}.yaml"),
        (fetch.main, "path={}.csv"),
        (reference_command.main, "path={}.md"),
        (train.main, "recording.path={}.csv"),
        (train.main, "output={}"),
        (train.main, "tracking.root={}"),
    ],
)
def test_a_name_that_no_file_can_have(
    main: Callable[[list[str]], int], word: str, name: str
) -> None:
    words = [word.format(name)]
    if main is command.main and not word.startswith("path"):
        words.append("path=my.csv")
    if main is train.main and not word.startswith("conf"):
        words.append("conf=rde")
    with pytest.raises(InputError) as refused:
        main(words)
    assert "Errno" not in str(refused.value) and len(str(refused.value)) < 400


def test_a_recording_cannot_be_a_url() -> None:
    with pytest.raises(InputError, match="a URL, not a local file"):
        load_config(["conf=rde", "recording.path=https://a.example/b.csv"], entry="train")


def test_a_port_with_another_protocol_is_not_a_server() -> None:
    with socket.create_server(("127.0.0.1", 0)) as other:
        port = other.getsockname()[1]

        def answer() -> None:
            with other.accept()[0] as asked:
                asked.recv(4096)
                asked.sendall(b"220 mail.example ESMTP\r\n")

        thread = threading.Thread(target=answer)
        thread.start()
        with pytest.raises(InputError, match="no MLflow server responds"):
            check_server(f"http://127.0.0.1:{port}")
        thread.join()
