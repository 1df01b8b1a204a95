"""The cluster of an analysis, which runs the calls of its simulator."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager

from dashred.config import Config
from dashred.core.cluster.calls import use_cluster
from dashred.core.cluster.word import read_cluster
from dashred.physics.external.adapters.command.left_behind import marks


@contextmanager
def analysis_cluster(config: Config) -> Iterator[None]:
    """Use the configured cluster for the length of a block.

    Raises:
        InputError: the cluster does not answer, does not start, or has other versions.
    """
    cluster = None if config.cluster is None else read_cluster(config.cluster)
    with use_cluster(cluster, marks()):
        yield
