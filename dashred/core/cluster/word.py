"""The word ``cluster=``: where the tasks of a command run."""

from __future__ import annotations

import re
from dataclasses import dataclass
from typing import Literal

LOCAL, SLURM, KUBERNETES = "local", "slurm", "kubernetes"
MAX_WORKERS = 1024
ADDRESS = re.compile(r"(tcp|tls)://[^\s:/]+:\d{1,5}\Z")
HELP = (
    "runs the cases on Dask workers in place of jobs=: `local` (a process for each core), a number "
    "of processes, the address of a scheduler, `slurm` or `kubernetes`; the last two take their "
    "settings from Dask's configuration"
)
EXAMPLES = "local|N|tcp://HOST:PORT|slurm|kubernetes"


@dataclass(frozen=True)
class Cluster:
    """A cluster that a command starts or connects to.

    Attributes:
        kind: processes of this machine, the scheduler at an address, or a batch system.
        workers: number of processes; None for as many as the kind gives by default.
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
    if text == LOCAL:
        return Cluster("local")
    if text == SLURM:
        return Cluster("slurm")
    if text == KUBERNETES:
        return Cluster("kubernetes")
    if re.fullmatch(r"\d{1,6}", text, re.ASCII):
        if not 1 <= int(text) <= MAX_WORKERS:
            raise ValueError(f"{text} is not a number of workers from 1 to {MAX_WORKERS}")
        return Cluster("local", int(text))
    if ADDRESS.match(text):
        return Cluster("address", address=text)
    raise ValueError(f"{text!r} is not one of {EXAMPLES}")
