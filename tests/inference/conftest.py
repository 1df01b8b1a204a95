"""Compiled systems that several test modules fit."""

from __future__ import annotations

import pytest

from tests.swing import Swing
from tests.waves import Waves


@pytest.fixture(scope="session")
def swing(tmp_path_factory: pytest.TempPathFactory) -> Swing:
    """A swing with all its candidates."""
    return Swing.declared(tmp_path_factory.mktemp("swing"))


@pytest.fixture(scope="session")
def waves(tmp_path_factory: pytest.TempPathFactory) -> Waves:
    """Two fields on a periodic axis, with windows."""
    return Waves.declared(tmp_path_factory.mktemp("waves"))
