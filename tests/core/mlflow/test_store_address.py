"""Addresses of stores and buckets, and the packages that they need."""

from __future__ import annotations

import sys
from pathlib import Path

import pytest

from dashred import train
from dashred.config import load_config
from dashred.core.errors import InputError
from dashred.core.mlflow.bucket import check_bucket
from dashred.core.mlflow.database import mlflow_uri
from dashred.core.mlflow.store_address import artifacts_address, check_address
from dashred.core.mlflow.store_check import check_store

DATABASE, BUCKET = "postgresql://team@db.example/mlflow", "s3://bucket/runs"


@pytest.mark.parametrize(
    ("root", "said"),
    [
        ("sqlite:////tmp/mlflow.db", "neither a folder nor a server"),
        ("sqlite:mlflow.db", "neither a folder nor a server"),
        ("s3://bucket/runs", "neither a folder nor a server"),
        ("mysql://me@host/mlflow", "neither a folder nor a server"),
        ("postgresql+psycopg2://me@host/mlflow", "neither a folder nor a server"),
        ("http://localhost:abc", "not the address of a server"),
        ("http://", "not the address of a server"),
        ("postgresql://me@host", "not the address of a database"),
        ("postgresql://me@host:0/mlflow", "not the address of a database"),
        ("http://me:secret@host:5000", "a server must not contain a password"),
        ("postgresql://me:secret@host/mlflow", "a database must not contain a password"),
        ("postgresql://host/mlflow?user=me&password=secret", "must not contain a password"),
    ],
)
def test_what_is_no_address_of_a_store(root: str, said: str) -> None:
    with pytest.raises(InputError, match=said) as refused:
        load_config(["conf=rde", f"tracking.root={root}"], entry="train")
    assert "secret" not in str(refused.value) and "command line" in str(refused.value)


@pytest.mark.parametrize(
    "root",
    [
        *("http://localhost:5000", "https://host/mlflow", "runs", "/tmp/a:b"),
        *(DATABASE, "postgresql:///mlflow?host=/run/postgresql", f"{DATABASE}?sslmode=require"),
    ],
)
def test_what_is_one_or_a_folder(root: str) -> None:
    check_address(root, "tracking.root")


@pytest.mark.parametrize(
    ("artifacts", "said"),
    [
        ("runs", "not the address of a bucket"),
        ("s3:///runs", "not the address of a bucket"),
        ("https://bucket.s3.example", "not the address of a bucket"),
        ("s3://KEY:secret@bucket/runs", "must not contain an access key"),
        ("s3://bucket/runs?versionId=1", "no \\? or #"),
    ],
)
def test_what_is_no_bucket(artifacts: str, said: str) -> None:
    words = ["conf=rde", f"tracking.root={DATABASE}", f"tracking.artifacts={artifacts}"]
    with pytest.raises(InputError, match=said) as refused:
        load_config(words, entry="train")
    assert "secret" not in str(refused.value) and "command line" in str(refused.value)


def test_a_folder_in_a_bucket_has_no_slash_at_its_end() -> None:
    assert artifacts_address(f"{BUCKET}/", "tracking.artifacts") == BUCKET


@pytest.mark.parametrize(
    ("words", "said"),
    [
        ([f"tracking.root={DATABASE}"], "a database does not hold the artifacts"),
        ([f"tracking.artifacts={BUCKET}"], "not used: they lie in the same folder"),
        (
            ["tracking.root=http://host:5000", f"tracking.artifacts={BUCKET}"],
            "not used: the server chooses",
        ),
    ],
)
def test_a_bucket_belongs_to_a_database(words: list[str], said: str) -> None:
    with pytest.raises(InputError, match=said):
        load_config(["conf=rde", *words], entry="train")


def test_a_run_that_exists_has_its_bucket() -> None:
    config = load_config(["conf=rde", f"tracking.root={DATABASE}", "tracking.run=0"], entry="train")
    assert config.tracking.artifacts is None


def test_the_address_for_mlflow_has_limits_of_time_which_the_user_may_set() -> None:
    assert mlflow_uri(DATABASE) == (
        "postgresql+psycopg://team@db.example/mlflow?connect_timeout=5&tcp_user_timeout=30000"
    )
    own = mlflow_uri(f"{DATABASE}?connect_timeout=60&sslmode=require")
    assert own.endswith("?connect_timeout=60&tcp_user_timeout=30000&sslmode=require")


@pytest.mark.parametrize(
    ("missing", "root", "artifacts"),
    [("psycopg", DATABASE, None), ("botocore.exceptions", "runs", BUCKET)],
)
def test_a_missing_package_is_named_with_the_command_that_installs_it(
    missing: str, root: str, artifacts: str | None, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setitem(sys.modules, missing, None)
    with pytest.raises(InputError, match="needs the package") as refused:
        check_store(root, artifacts)
    assert refused.value.hint == "pip install 'dashred[servers]'"


def test_nothing_is_written_before_the_store_is_checked(
    quick: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setitem(sys.modules, "psycopg", None)
    places = [f"tracking.root={DATABASE}", f"tracking.artifacts={BUCKET}"]
    with pytest.raises(InputError, match="needs the package psycopg"):
        train.main([f"conf={quick}", f"output={tmp_path / 'output'}", *places])
    assert not list(tmp_path.iterdir())


def test_an_address_of_no_server_is_said_so(monkeypatch: pytest.MonkeyPatch) -> None:
    pytest.importorskip("boto3", reason="boto3 is in dashred[servers]")
    monkeypatch.setenv("MLFLOW_S3_ENDPOINT_URL", "127.0.0.1:9")
    monkeypatch.setenv("AWS_ACCESS_KEY_ID", "key")
    monkeypatch.setenv("AWS_SECRET_ACCESS_KEY", "secret")
    with pytest.raises(InputError, match="Invalid endpoint") as refused:
        check_bucket(BUCKET)
    assert "MLFLOW_S3_ENDPOINT_URL" in str(refused.value)
