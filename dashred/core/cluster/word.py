"""The word ``cluster=``: where the tasks of a command run."""

from __future__ import annotations

import re
from dataclasses import dataclass
from typing import Literal

# Where messages about a cluster say the problem is.
WHERE = "cluster="
MAX_WORKERS = 1024
ADDRESS = re.compile(r"(tcp|tls)://[^\s:/]+:\d{1,5}\Z")
BATCH = re.compile(r"(slurm|kubernetes):(\d{1,6})\Z", re.ASCII)
NUMBER = re.compile(r"\d{1,6}\Z", re.ASCII)
HELP = (
    "runs the cases or rows on Dask workers in place of jobs=: `local` (a process for each core), "
    "a number of processes, the address of a scheduler, or workers of a batch system, whose "
    "settings are in Dask's configuration"
)
EXAMPLES = "local|N|tcp://HOST:PORT|slurm:N|kubernetes:N"


@dataclass(frozen=True)
class Cluster:
    """A cluster that a command starts or connects to.

    Attributes:
        kind: processes of this machine, the scheduler at an address, or a batch system.
        workers: number of workers; None for a process on each core, and for a scheduler at an
            address, whose workers are counted.
        address: address of the scheduler; empty for other kinds.
    """

    kind: Literal["local", "address", "slurm", "kubernetes"]
    workers: int | None = None
    address: str = ""


def read_cluster(text: str) -> Cluster:
    """Read the word ``cluster=``.

    Raises:
        ValueError: the text names no cluster.
    """
    if text == "local":
        return Cluster("local")
    if NUMBER.match(text):
        return Cluster("local", _read_count(text))
    if ADDRESS.match(text):
        return Cluster("address", address=text)
    if match := BATCH.match(text):
        kind: Literal["slurm", "kubernetes"] = "slurm" if match[1] == "slurm" else "kubernetes"
        return Cluster(kind, _read_count(match[2]))
    raise ValueError(f"{text!r} does not name a cluster")


def _read_count(text: str) -> int:
    if not 1 <= int(text) <= MAX_WORKERS:
        raise ValueError(f"{text} is not a number of workers from 1 to {MAX_WORKERS}")
    return int(text)
