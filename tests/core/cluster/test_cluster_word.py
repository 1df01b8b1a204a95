"""The word ``cluster=`` as users type it."""

from __future__ import annotations

import pytest

from dashred.core.cluster.word import Cluster, read_cluster


@pytest.mark.parametrize(
    ("text", "cluster"),
    [
        ("local", Cluster("local")),
        ("4", Cluster("local", 4)),
        ("tcp://10.0.0.1:8786", Cluster("address", address="tcp://10.0.0.1:8786")),
        ("tls://head.cluster:8786", Cluster("address", address="tls://head.cluster:8786")),
        ("slurm:40", Cluster("slurm", 40)),
        ("kubernetes:3", Cluster("kubernetes", 3)),
    ],
)
def test_a_word_names_a_cluster(text: str, cluster: Cluster) -> None:
    assert read_cluster(text) == cluster


@pytest.mark.parametrize(
    "text", ["", "many", "0", "99999", "tcp://host", "http://a:80", "-2", "slurm", "slurm:0"]
)
def test_other_words_are_refused(text: str) -> None:
    with pytest.raises(ValueError, match=r"does not name a cluster|from 1 to"):
        read_cluster(text)
