"""A check of a bundled system takes seconds, with its twin's recording or before there is one."""

from __future__ import annotations

import subprocess
import sys
import time
from pathlib import Path

import pytest

from dashred.evaluation.twins import record_command
from tests.conftest import CHECKOUT

SYSTEMS = sorted(path.stem for path in (CHECKOUT / "conf").glob("*.yaml") if path.stem != "base")
SECONDS = 10.0


@pytest.mark.slow
@pytest.mark.parametrize("system", SYSTEMS)
def test_a_check_of_a_bundled_system_takes_seconds(system: str, tmp_path: Path) -> None:
    recorded = tmp_path / "recorded"
    assert record_command.main([f"conf={system}", "recording.twin=a", f"output={recorded}"]) == 0
    for words in ([], [f"recording.path={recorded / 'recording.nc'}"]):
        began = time.perf_counter()
        ended = subprocess.run(
            [sys.executable, "-m", "dashred", "check", f"conf={system}", *words],
            cwd=CHECKOUT,
            capture_output=True,
            text=True,
        )
        seconds = time.perf_counter() - began
        assert ended.returncode == 0, ended.stdout + ended.stderr
        assert seconds < SECONDS
