"""Runs whose store is PostgreSQL and whose artifacts are in a bucket: both are real servers."""

from __future__ import annotations

import json
import os
import shlex
import signal
import socket
import subprocess
import sys
import time
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import pytest

from dashred.core.mlflow import store_requests
from dashred.core.mlflow.connection_errors import StoreUnreachableError
from dashred.core.mlflow.database import mlflow_uri
from dashred.core.mlflow.store_check import check_store
from dashred.core.mlflow.tracker import Tracker
from dashred.core.system_errors import ExternalServiceError
from tests.conftest import CHECKOUT, Ended
from tests.documents import snippets
from tests.support.open_together import OPEN_TOGETHER
from tests.support.servers import BUCKET, Bucket, Postgres, free_ports, wait_for_health

pytestmark = [
    pytest.mark.servers,
    # The clients of these tests are MLflow's own, whose code SQLAlchemy 2.1 warns of.
    pytest.mark.filterwarnings("ignore:The ``noload`` loader"),
]

ARTIFACTS = f"s3://{BUCKET}/dashred"
# An analysis whose patience is short.
HASTY = """
import sys
from dashred.core.mlflow import store_requests
from dashred.core.command_line.entry import run_entry
store_requests.PATIENCE = 3.0
from dashred.train import main
sys.exit(run_entry(main))
"""


@pytest.fixture(scope="module")
def postgres() -> Iterator[Postgres]:
    server = Postgres()
    yield server
    server.close()


@pytest.fixture(scope="module")
def bucket() -> Iterator[Bucket]:
    server = Bucket()
    yield server
    server.close()


@pytest.fixture(scope="module", autouse=True)
def user(postgres: Postgres, bucket: Bucket) -> Iterator[None]:
    """The environment of a user of both servers."""
    with pytest.MonkeyPatch.context() as patch:
        patch.setenv("PGPASSWORD", postgres.password)
        for name, value in bucket.variables.items():
            patch.setenv(name, value)
        # Without it, boto3 looks for keys on the network where the environment has none.
        patch.setenv("AWS_EC2_METADATA_DISABLED", "true")
        patch.setenv("NO_COLOR", "1")
        patch.setenv("COLUMNS", "200")
        yield


def documented(sign: str, *changes: tuple[str, str]) -> list[str]:
    """Return the words of the command of docs/mlflow.md with a sign, with the addresses changed."""
    lines = "".join(snippets(CHECKOUT / "docs" / "mlflow.md", "sh")).splitlines()
    [line] = [line for line in lines if sign in line]
    for shown, here in changes:
        assert shown in line
        line = line.replace(shown, here)
    return shlex.split(line)


@pytest.fixture(scope="module")
def store(postgres: Postgres, bucket: Bucket) -> list[str]:
    """The words of a command that name both."""
    changes = ("db.example", f"127.0.0.1:{postgres.port}")
    words = documented("tracking.artifacts=", changes)
    assert words[3:] == [f"tracking.root={postgres.address}", f"tracking.artifacts={ARTIFACTS}"]
    return words[3:]


def train(*words: str, program: str | None = None) -> subprocess.Popen[str]:
    """Start ``dashred train``, or a program in its place."""
    start = ["-m", "dashred.train"] if program is None else ["-c", program]
    return subprocess.Popen(
        [sys.executable, "-u", *start, *words],
        cwd=CHECKOUT,
        stdin=subprocess.DEVNULL,
        stdout=subprocess.PIPE,
        stderr=subprocess.STDOUT,
        text=True,
    )


def printed_until(process: subprocess.Popen[str], sign: str) -> str:
    """Return what a process prints up to a line with the sign."""
    assert process.stdout is not None
    said = ""
    for line in process.stdout:
        said += line
        if sign in line:
            return said
    pytest.fail(f"{sign!r} was not printed:\n{said}")


def client_of(address: str) -> Any:
    from mlflow import MlflowClient

    return MlflowClient(tracking_uri=mlflow_uri(address))


def run_of(output: Path) -> str:
    return str(json.loads((output / "run.json").read_text())["mlflow_run"])


def curves(client: Any, run_id: str) -> dict[str, list[tuple[int, str]]]:
    """Return the points of all curves of a run and of its nested runs, but not the seconds."""
    experiment = client.get_run(run_id).info.experiment_id
    nested = client.search_runs([experiment], f"tags.`mlflow.parentRunId` = '{run_id}'")
    found = {}
    for run in (client.get_run(run_id), *nested):
        name = "" if run.info.run_id == run_id else f"{run.info.run_name}: "
        for key in run.data.metrics:
            if not key.startswith(("score/", "surrogate/")):
                history = client.get_metric_history(run.info.run_id, key)
                found[name + key] = sorted((point.step, repr(point.value)) for point in history)
        assert run.info.status == "FINISHED"
    return found


@pytest.fixture(scope="module")
def sent(
    store: list[str], quick: Path, own_state: Path, tmp_path_factory: pytest.TempPathFactory
) -> tuple[Path, str]:
    """A twin experiment with its model on both servers: its output, and what it printed."""
    output = tmp_path_factory.mktemp("sent") / "output"
    run = train(f"conf={quick}", f"output={output}", *store, "tracking.model=true")
    said, _ = run.communicate()
    assert run.returncode == 0, said
    return output, said


def test_a_client_reads_curves_coefficients_artifacts_and_the_model(
    sent: tuple[Path, str], postgres: Postgres, bucket: Bucket, twin_run: Ended, tmp_path: Path
) -> None:
    client, run_id = client_of(postgres.address), run_of(sent[0])
    run = client.get_run(run_id)
    assert run.info.status == "FINISHED" and run.data.tags["twin"] == "a"
    assert run.info.artifact_uri == f"{ARTIFACTS}/{run_id}/artifacts"
    alone = client_of_folder(twin_run.root)
    assert curves(client, run_id) == curves(alone, run_of(twin_run.output))
    assert len(client.get_metric_history(run_id, "shred/rmse/field_members")) > 1
    assert any(key.startswith("coef/u/") for key in run.data.metrics)
    kept = Path(client.download_artifacts(run_id, "findings.json", str(tmp_path)))
    assert kept.read_bytes() == (sent[0] / "findings.json").read_bytes()
    assert kept.read_bytes() == twin_run.read("findings.json")
    stored = bucket.objects()
    for name in ("findings.json", "report.html", "corrected.yaml", "space_time.png"):
        own = (sent[0] / name).read_bytes()
        assert stored[f"dashred/{run_id}/artifacts/{name}"] == own
    [model] = client.search_logged_models([run.info.experiment_id])
    assert model.name == "corrected_shred" and model.artifact_location.startswith(ARTIFACTS)
    assert any(key.endswith(".pt2") for key in stored)


def client_of_folder(root: Path) -> Any:
    from mlflow import MlflowClient

    return MlflowClient(tracking_uri=f"sqlite:///{root / 'mlflow.db'}")


def test_no_password_is_stored_or_printed(
    sent: tuple[Path, str], postgres: Postgres, bucket: Bucket, own_state: Path
) -> None:
    output, said = sent
    tables = "SELECT table_name FROM information_schema.tables WHERE table_schema = 'public'"
    rows = [postgres.execute(f'SELECT * FROM "{name}"') for [name] in postgres.execute(tables)]
    assert ARTIFACTS in str(rows) and "quick seed 0" in str(rows)
    assert '"mlflow_run"' in (output / "run.json").read_text()
    files = [path for folder in (output, own_state) for path in folder.rglob("*")]
    contents = [path.read_bytes() for path in files if path.is_file()]
    contents += [*bucket.objects().values(), str(rows).encode(), said.encode()]
    for secret in (postgres.password, bucket.secret):
        assert not any(secret.encode() in content for content in contents)


def test_the_default_experiment_of_a_new_database_has_a_bucket(
    sent: tuple[Path, str], postgres: Postgres
) -> None:
    """Else MLflow would name a folder of the machine that came first."""
    asked = "SELECT artifact_location FROM experiments WHERE name = 'Default'"
    assert postgres.execute(asked) == [(f"{ARTIFACTS}/0",)]


def test_two_analyses_begin_at_once_in_a_new_database(
    postgres: Postgres, bucket: Bucket, quick: Path, twin_run: Ended, tmp_path: Path
) -> None:
    address = postgres.new_database()
    places = [f"tracking.root={address}", f"tracking.artifacts={ARTIFACTS}"]
    outputs = [tmp_path / "one", tmp_path / "two"]
    runs = [train(f"conf={quick}", f"output={output}", *places) for output in outputs]
    told = [run.communicate()[0] for run in runs]
    assert [run.returncode for run in runs] == [0, 0], told
    client = client_of(address)
    [experiment] = client.search_experiments(filter_string="name = 'quick'")
    for output in outputs:
        assert (output / "findings.json").read_bytes() == twin_run.read("findings.json")
        assert client.get_run(run_of(output)).info.experiment_id == experiment.experiment_id
    one, two = (curves(client, run_of(output)) for output in outputs)
    assert one == two


def test_processes_open_a_new_database_at_the_same_moment(postgres: Postgres) -> None:
    address = postgres.new_database()
    command = [sys.executable, "-c", OPEN_TOGETHER, address, ARTIFACTS]
    ended = subprocess.run(command, cwd=CHECKOUT, capture_output=True, text=True)
    assert ended.returncode == 0, ended.stderr
    client = client_of(address)
    [experiment] = client.search_experiments(filter_string="name = 'rde'")
    assert len(client.search_runs([experiment.experiment_id])) == 8
    assert "Traceback" not in ended.stderr


@pytest.fixture
def analysis(quick: Path, twin_run: Ended, store: list[str]) -> list[str]:
    """The words of an analysis of a recording, which runs in one process."""
    return [f"conf={quick}", f"recording.path={twin_run.output / 'recording.nc'}", *store]


def undisturbed(twin_run: Ended) -> Any:
    return curves(client_of_folder(twin_run.root), run_of(twin_run.output))


def test_a_run_goes_on_when_the_database_is_restarted(
    analysis: list[str], postgres: Postgres, twin_run: Ended, tmp_path: Path
) -> None:
    run = train(*analysis, f"output={tmp_path}")
    printed_until(run, "train SHRED")
    postgres.stop()
    said = printed_until(run, "the MLflow store does not answer")
    postgres.start()
    rest, _ = run.communicate()
    assert run.returncode == 0, said + rest
    assert rest.count("the MLflow store answers again") == 1
    assert "does not answer" not in rest and "Traceback" not in said + rest
    assert curves(client_of(postgres.address), run_of(tmp_path)) == undisturbed(twin_run)


def test_a_run_ends_when_the_database_stays_away_and_is_resumed(
    analysis: list[str], postgres: Postgres, twin_run: Ended, tmp_path: Path
) -> None:
    run = train(*analysis, f"output={tmp_path}", program=HASTY)
    printed_until(run, "train SHRED")
    postgres.stop()
    said, _ = run.communicate()
    postgres.start()
    assert run.returncode == 1 and "Traceback" not in said, said
    run_id = (tmp_path / ".run").read_text().strip()
    root = f"tracking.root={postgres.address}"
    assert said.count("error: ") == 1
    assert said.endswith(f" continue with resume={run_id} {root}\n")
    again = train(f"resume={run_id}", root, f"output={tmp_path}")
    told, _ = again.communicate()
    assert again.returncode == 0, told
    assert "train SHRED" not in told  # it is read from its checkpoint
    assert (tmp_path / "findings.json").read_bytes() == twin_run.read("findings.json")
    assert curves(client_of(postgres.address), run_id) == undisturbed(twin_run)


def test_a_run_whose_bucket_goes_away_is_resumed(
    analysis: list[str], postgres: Postgres, bucket: Bucket, twin_run: Ended, tmp_path: Path
) -> None:
    run = train(*analysis, f"output={tmp_path}", program=HASTY)
    printed_until(run, "train SHRED")
    bucket.stop()
    said, _ = run.communicate()
    bucket.start()
    assert run.returncode == 1 and "Traceback" not in said, said
    assert said.count("error: ") == 1
    run_id = (tmp_path / ".run").read_text().strip()
    again = train(f"resume={run_id}", f"tracking.root={postgres.address}", f"output={tmp_path}")
    told, _ = again.communicate()
    assert again.returncode == 0, told
    stored = bucket.objects()[f"dashred/{run_id}/artifacts/findings.json"]
    assert stored == twin_run.read("findings.json")


def test_a_killed_run_is_resumed(
    analysis: list[str], postgres: Postgres, twin_run: Ended, tmp_path: Path
) -> None:
    run = train(*analysis, f"output={tmp_path}")
    printed_until(run, "train SHRED")
    run.send_signal(signal.SIGKILL)
    run.communicate()
    run_id = (tmp_path / ".run").read_text().strip()
    assert client_of(postgres.address).get_run(run_id).info.status == "RUNNING"
    again = train(f"resume={run_id}", f"tracking.root={postgres.address}", f"output={tmp_path}")
    told, _ = again.communicate()
    assert again.returncode == 0, told
    assert (tmp_path / "findings.json").read_bytes() == twin_run.read("findings.json")
    assert curves(client_of(postgres.address), run_id) == undisturbed(twin_run)


def test_a_stage_that_ends_while_the_database_is_away_is_kept(
    postgres: Postgres, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(store_requests, "PATIENCE", 0.0)
    monkeypatch.setattr("dashred.core.mlflow.run.SEND_EVERY", 0.0)
    place, opened = (postgres.address, "kept"), ""
    with (
        pytest.raises(ExternalServiceError, match="continue with resume="),
        Tracker.open(*place, "a run", artifacts=ARTIFACTS) as run,
    ):
        opened = run.run_id
        with run.child("shred") as child:
            child.log_metrics({"rmse": 0.0}, 0)
            postgres.stop()
            for step in (1, 2):
                child.log_metrics({"rmse": float(step)}, step)
                run.log_metrics({"shred/rmse": float(step)}, step)
        stage_is_kept = True
        run.set_tags({"a": "b"})
    postgres.start()
    assert stage_is_kept
    with Tracker.reopen(*place, opened):
        pass
    client = client_of(postgres.address)
    steps = [point.step for point in client.get_metric_history(child.run_id, "rmse")]
    assert sorted(steps) == [0, 1, 2]
    assert len(client.get_metric_history(opened, "shred/rmse")) == 2
    assert client.get_run(child.run_id).info.status == "FINISHED"
    assert client.get_run(opened).info.status == "FINISHED"


REFUSED = [
    ({"PGPASSWORD": "wr0ng"}, "password authentication failed"),
    ({"PGPASSWORD": ""}, "asks for a password"),
    ({"AWS_SECRET_ACCESS_KEY": "wr0ng"}, "refuses to write there: SignatureDoesNotMatch"),
    ({"AWS_ACCESS_KEY_ID": "wr0ng"}, "refuses to write there: InvalidAccessKeyId"),
    ({"AWS_ACCESS_KEY_ID": "", "AWS_SECRET_ACCESS_KEY": ""}, "no access key is given"),
    ({"MLFLOW_S3_ENDPOINT_URL": "http://127.0.0.1:9"}, "no S3 server responds"),
    ({"tracking.root": "postgresql://team@127.0.0.1:9/mlflow"}, "no PostgreSQL server"),
    ({"tracking.root": "postgresql://team@127.0.0.1:{port}/none"}, '"none" does not exist'),
    ({"tracking.artifacts": "s3://none/dashred"}, "there is no bucket none"),
]


@pytest.mark.parametrize(
    ("command", "change", "said"),
    [*(("train", *case) for case in REFUSED), ("check", *REFUSED[0]), ("check", *REFUSED[-1])],
    ids=str,
)
def test_a_store_that_cannot_be_used_is_refused_at_once(
    command: str,
    change: dict[str, str],
    said: str,
    quick: Path,
    store: list[str],
    postgres: Postgres,
    tmp_path: Path,
) -> None:
    change = {key: value.format(port=postgres.port) for key, value in change.items()}
    words = [f"{key}={value}" for key, value in change.items() if "." in key]
    kept = [word for word in store if word.partition("=")[0] not in change]
    variables = {key: value for key, value in change.items() if "." not in key}
    words += [f"conf={quick}", f"output={tmp_path / 'output'}"]
    ended = subprocess.run(
        [sys.executable, "-m", "dashred", command, *kept, *words],
        cwd=CHECKOUT,
        env=os.environ | variables,
        capture_output=True,
        text=True,
    )
    assert ended.returncode == 2, ended.stderr
    assert said in ended.stderr and len(ended.stderr.splitlines()) <= 2
    assert "wr0ng" not in ended.stderr and not (tmp_path / "output").exists()


def test_an_address_where_nothing_answers_is_given_up_within_seconds(
    store: list[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    """A listener that accepts connections and says nothing is the worst of them."""
    with socket.create_server(("127.0.0.1", 0)) as silent:
        port = silent.getsockname()[1]
        for root, artifacts in (
            (f"postgresql://team@127.0.0.1:{port}/mlflow", None),
            (str(Path.cwd()), ARTIFACTS),
        ):
            monkeypatch.setenv("MLFLOW_S3_ENDPOINT_URL", f"http://127.0.0.1:{port}")
            began = time.monotonic()
            with pytest.raises(StoreUnreachableError):
                check_store(root, artifacts)
            assert time.monotonic() - began < 60


@contextmanager
def serving(command: list[str], url: str, folder: Path) -> Iterator[None]:
    """Run an MLflow server for the length of a block."""
    with (folder / "log").open("ab") as log:
        server = subprocess.Popen(
            command, cwd=folder, stdout=log, stderr=log, start_new_session=True
        )
        try:
            wait_for_health(url, server)
            yield
        finally:
            os.killpg(server.pid, signal.SIGKILL)
            server.wait()


def test_a_server_in_front_of_both_is_killed_and_started_again(
    analysis: list[str], postgres: Postgres, bucket: Bucket, twin_run: Ended, tmp_path: Path
) -> None:
    """The server alone has the passwords."""
    [port] = free_ports(1)
    url, address = f"http://127.0.0.1:{port}", postgres.new_database()
    changes = [("0.0.0.0", "127.0.0.1"), ("mlflow.example", "127.0.0.1"), ("5000", str(port))]
    changes += [("team@db.example/mlflow", address.removeprefix("postgresql://"))]
    command = [sys.executable, "-m", *documented("s3://runs/served", *changes)]
    command += ["--workers", "1"]
    words = [*analysis[:2], f"tracking.root={url}", f"output={tmp_path / 'output'}"]
    with serving(command, url, tmp_path):
        with pytest.MonkeyPatch.context() as patch:
            for name in ("PGPASSWORD", *bucket.variables):
                patch.delenv(name)
            run = train(*words)
        printed_until(run, "train SHRED")
    said = printed_until(run, "the MLflow store does not answer")
    with serving(command, url, tmp_path):
        rest, _ = run.communicate()
    assert run.returncode == 0 and "Traceback" not in said + rest, said + rest
    run_id, client = run_of(tmp_path / "output"), client_of(address)
    assert curves(client, run_id) == undisturbed(twin_run)
    experiment = client.get_run(run_id).info.experiment_id
    stored = bucket.objects()[f"served/{experiment}/{run_id}/artifacts/findings.json"]
    assert stored == twin_run.read("findings.json")
