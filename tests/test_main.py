"""``python -m dashred`` names commands that there are."""

from __future__ import annotations

import re
import subprocess
import sys

from dashred.__main__ import COMMANDS
from tests.conftest import CHECKOUT


def test_the_commands_that_it_names_are_there() -> None:
    ended = subprocess.run(
        [sys.executable, "-m", "dashred"], cwd=CHECKOUT, capture_output=True, text=True
    )
    assert ended.returncode == 2 and ended.stdout == COMMANDS
    named = re.findall(r"^  (\w+) ", COMMANDS, re.MULTILINE)
    assert {"init", "check", "train", "bench", "compare", "prove"} <= set(named)
    for name in named:
        assert "run_entry(main)" in (CHECKOUT / "dashred" / f"{name}.py").read_text()
