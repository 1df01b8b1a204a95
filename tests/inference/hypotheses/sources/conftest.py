"""A compiled channel that several modules fit."""

from __future__ import annotations

import pytest

from tests.channel import Channel


@pytest.fixture(scope="session")
def channel(tmp_path_factory: pytest.TempPathFactory) -> Channel:
    """A linear tracer on a ring."""
    return Channel.declared(tmp_path_factory.mktemp("channel"))
