"""The compiled swing that several modules fit."""

from __future__ import annotations

import pytest

from tests.swing import Swing


@pytest.fixture(scope="session")
def swing(tmp_path_factory: pytest.TempPathFactory) -> Swing:
    """A swing with all its candidates in reach."""
    return Swing.declared(tmp_path_factory.mktemp("swing"))
