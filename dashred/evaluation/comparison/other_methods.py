"""Run the other methods on the recording of a twin, then score them.

Two processes: the first is handed the recording in a folder of its own, where no seal lies, the
second opens the seal when the first has written what it found.
"""

from __future__ import annotations

import shutil
import subprocess
import sys
import tempfile
from dataclasses import dataclass
from pathlib import Path

from dashred.core.command_line.argument_types import read_number, read_path
from dashred.core.command_line.arguments import Command, argument, declared_arguments
from dashred.core.command_line.entry import run_entry
from dashred.core.errors import DONE
from dashred.evaluation.baselines.analyse import FIELDS, LAWS
from dashred.evaluation.comparison.method_scores import ESTIMATES
from dashred.evaluation.twins.twin_experiment import analysis_arguments


@dataclass(frozen=True, kw_only=True)
class Arguments:
    """The words of this process; all others are those of the row's analysis."""

    folder: Path = argument(read_path, "DIR", "folder of the row")
    noise: float = argument(read_number, "0.05", "of the row")


COMMAND = Command(
    "python -m dashred.evaluation.comparison.other_methods",
    Arguments,
    "Runs the other methods on the recording of a row, and scores all of them.",
    rest="the words of the row's analysis",
)


def main(argv: list[str]) -> int:
    """Analyse and score; return the exit code of the first process that fails.

    If the process of the other methods fails, the analysis is still scored. If the analysis has no
    field, the other methods are not run.
    """
    own = {one.name for one in declared_arguments(Arguments)}
    row = COMMAND.read([text for text in argv if text.partition("=")[0] in own])
    words = [text for text in argv if text.partition("=")[0] not in own]
    folder = row.folder
    seed = next((text for text in words if text.startswith("seed=")), "seed=0")
    # Files of an earlier attempt do not belong to these findings.
    for name in (FIELDS, LAWS):
        (folder / name).unlink(missing_ok=True)
    code = _analyse(folder, words) if (folder / ESTIMATES).is_file() else DONE
    scored = _run(
        "dashred.evaluation.comparison.method_scores",
        [f"folder={folder}", f"noise={row.noise:.12g}", seed],
    )
    return scored or code


def _analyse(folder: Path, words: list[str]) -> int:
    with tempfile.TemporaryDirectory(prefix="dashred-baselines-") as private:
        recording = Path(private) / "recording.nc"
        shutil.copyfile(folder / "recording.nc", recording)
        found = Path(private) / "found"
        code = _run(
            "dashred.evaluation.baselines.analyse", analysis_arguments(words, recording, found)
        )
        if code == DONE:
            for name in (FIELDS, LAWS):
                if (found / name).is_file():
                    shutil.move(found / name, folder / name)
    return code


def _run(module: str, words: list[str]) -> int:
    code = subprocess.run([sys.executable, "-m", module, *words], check=False).returncode
    return DONE if code == DONE else max(code, 1)


if __name__ == "__main__":
    sys.exit(run_entry(main))
