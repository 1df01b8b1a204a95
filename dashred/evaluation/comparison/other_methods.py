"""The other methods on a twin's recording, then the seal.

``python -m dashred.evaluation.comparison.other_methods folder=DIR noise=0.01 conf=heat …``: one row.

Two processes: the first is handed the recording in a folder of its own, where no seal lies, the
second opens the seal when the first has written what it found.
"""

from __future__ import annotations

import shutil
import subprocess
import sys
import tempfile
from pathlib import Path

from dashred.core.errors import DONE, run_entry
from dashred.evaluation.baselines.analyse import FIELDS, LAWS
from dashred.evaluation.comparison.method_scores import ESTIMATES
from dashred.evaluation.twins.twin_experiment import words_of_analysis


def main(argv: list[str]) -> int:
    """Analyse and score; returns the exit code of the first process that fails.

    Where the other methods fail as a whole, the analysis is scored all the same; where it has no
    field, there is nothing to hold them against, and they are not run.
    """
    own = dict(word.partition("=")[::2] for word in argv if word.startswith(("folder=", "noise=")))
    words = [word for word in argv if not word.startswith(("folder=", "noise="))]
    folder = Path(own["folder"])
    seed = next((word for word in words if word.startswith("seed=")), "seed=0")
    # What is left of an earlier attempt is not of these findings.
    for name in (FIELDS, LAWS):
        (folder / name).unlink(missing_ok=True)
    code = _analyse(folder, words) if (folder / ESTIMATES).is_file() else DONE
    scored = _run(
        "dashred.evaluation.comparison.method_scores",
        [f"folder={folder}", f"noise={own['noise']}", seed],
    )
    return scored or code


def _analyse(folder: Path, words: list[str]) -> int:
    with tempfile.TemporaryDirectory(prefix="dashred-baselines-") as private:
        recording = Path(private) / "recording.nc"
        shutil.copyfile(folder / "recording.nc", recording)
        found = Path(private) / "found"
        code = _run(
            "dashred.evaluation.baselines.analyse", words_of_analysis(words, recording, found)
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
