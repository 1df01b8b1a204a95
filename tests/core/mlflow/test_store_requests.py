"""Requests to a store that does not answer for a while, and what is kept meanwhile."""

from __future__ import annotations

import math
from collections.abc import Callable
from pathlib import Path

import pytest
from mlflow.entities import Metric
from mlflow.exceptions import MlflowException
from mlflow.protos.databricks_pb2 import INVALID_PARAMETER_VALUE, TEMPORARILY_UNAVAILABLE
from requests.exceptions import ConnectionError

from dashred.core.mlflow import store_requests
from dashred.core.mlflow.connection_errors import StoreUnreachableError, is_outage
from dashred.core.mlflow.store_requests import Requests
from dashred.core.mlflow.tracker import Tracker
from dashred.core.mlflow.unsent import add_unsent, read_unsent
from dashred.core.system_errors import ExternalServiceError

SERVER, HINT = "http://127.0.0.1:5000", "resume it"


class Clock:
    """A clock that only sleeping moves on."""

    def __init__(self) -> None:
        self.now = 0.0

    def monotonic(self) -> float:
        """Return the seconds that were slept."""
        return self.now

    def sleep(self, seconds: float) -> None:
        """Move on at once."""
        self.now += seconds


@pytest.fixture
def clock(monkeypatch: pytest.MonkeyPatch) -> Clock:
    own = Clock()
    monkeypatch.setattr(store_requests, "time", own)
    return own


def failing(times: int, error: Exception) -> Callable[[], str]:
    """Return a request that fails a number of times, and is answered then."""
    left = [times]

    def request() -> str:
        left[0] -= 1
        if left[0] >= 0:
            raise error
        return "answer"

    return request


DOWN = ConnectionError("nobody listens\nand a second line")


def test_a_server_that_comes_back_is_waited_for_and_said_once(
    clock: Clock, capsys: pytest.CaptureFixture[str]
) -> None:
    assert Requests(SERVER, HINT).send(failing(5, DOWN)) == "answer"
    assert clock.now == 1 + 2 + 5 + 10 + 10
    printed = capsys.readouterr().out
    assert printed.count("does not answer: nobody listens\n") == 1
    assert printed.count("answers again") == 1


def test_a_server_that_stays_away_ends_the_run_after_the_patience(clock: Clock) -> None:
    requests = Requests(SERVER, HINT)
    with pytest.raises(ExternalServiceError, match="nobody listens") as ended:
        requests.send(failing(1000, DOWN))
    assert str(ended.value).endswith(f"\n  {HINT}") and "second line" not in str(ended.value)
    assert store_requests.PATIENCE - 10 < clock.now <= store_requests.PATIENCE
    waited = clock.now
    with pytest.raises(ExternalServiceError):
        requests.send(failing(1000, DOWN))
    assert clock.now == waited and requests.gave_up
    assert requests.send(failing(0, DOWN)) == "answer" and not requests.gave_up


@pytest.mark.parametrize(
    ("root", "error"),
    [
        (SERVER, MlflowException("too long", INVALID_PARAMETER_VALUE)),
        ("/a/folder", MlflowException("database is locked", TEMPORARILY_UNAVAILABLE)),
    ],
)
def test_what_would_fail_again_is_not_repeated(clock: Clock, root: str, error: Exception) -> None:
    with pytest.raises(ExternalServiceError):
        Requests(root, HINT).send(failing(1, error))
    with pytest.raises(ExternalServiceError):
        Requests(root, HINT).attempt(failing(1, error))
    assert clock.now == 0


def test_an_attempt_that_is_not_answered_does_not_hold_the_run_up(clock: Clock) -> None:
    requests, request = Requests(SERVER, HINT), failing(1, DOWN)
    assert [requests.attempt(request), requests.attempt(request)] == [False, True]
    assert clock.now == 0


def test_which_errors_are_outages() -> None:
    wrapped = MlflowException("API request failed")
    wrapped.__cause__ = DOWN
    assert is_outage(MlflowException("request failed with error code 502 != 200"))
    assert is_outage(wrapped) and is_outage(StoreUnreachableError("nobody listens"))
    assert not is_outage(MlflowException("no such run")) and not is_outage(ValueError("bug"))


def test_a_file_keeps_what_was_not_sent_exactly(tmp_path: Path) -> None:
    path = tmp_path / "run" / "unsent.json"
    first, second = Metric("a", 1 / 3, 17, 0), Metric("b", math.nan, 18, 1)
    add_unsent(path, {"child": [first], "parent": []}, ended="child")
    add_unsent(path, {"other": [second], "parent": [first]}, ended="other")
    points, ended = read_unsent(path)
    assert ended == ["child", "other"]
    assert dict(points["child"][0]) == dict(first) and dict(points["parent"][0]) == dict(first)
    [gap] = points["other"]
    assert (gap.key, gap.timestamp, gap.step) == ("b", 18, 1) and math.isnan(gap.value)


def test_a_stage_is_kept_although_its_last_points_cannot_be_sent(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """They are in the store after the next run that is resumed."""
    from mlflow import MlflowClient

    root = str(tmp_path / "mlruns")
    monkeypatch.setattr("dashred.core.mlflow.run.SEND_EVERY", 1e9)
    with Tracker.open(root, "rde", "a run") as run:
        with monkeypatch.context() as patch, run.child("shred") as child:
            child.log_metrics({"rmse": 1.0}, 0)
            child.log_metrics({"rmse": math.nan}, 1)
            patch.setattr(child, "_finish", lambda: child.request(failing(1, DOWN)))
        client = MlflowClient(run.uri)
        assert client.get_run(child.run_id).info.status == "RUNNING"
    history = client.get_metric_history(child.run_id, "rmse")
    assert [(point.step, math.isnan(point.value)) for point in history] == [(0, False), (1, True)]
    assert client.get_run(child.run_id).info.status == "FINISHED"
    assert not (tmp_path / "mlruns" / "artifacts" / run.run_id / "unsent.json").exists()
