"""A twin experiment: recorder, analysis and scorer, each a process of its own.

The analysis is handed the path of the recording and nothing else of the twin: not its name, not
its noise, not its random stream. The seal lies in a private folder until the findings are frozen.
"""

from __future__ import annotations

import shutil
import subprocess
import sys
import tempfile
from pathlib import Path

from dashred.config import Config
from dashred.errors import DONE
from dashred.mlflow_store import open_store
from dashred.tracking import Tracker

PRIVATE = ("recording.", "output=", "tracking.run=", "conf=")


def run_twin(config: Config, argv: list[str]) -> int:
    """Record, analyse, score; returns the exit code of the first process that fails."""
    experiment = config.tracking.experiment or config.name
    words = [f"conf={config.source}", *(w for w in argv if not w.startswith(PRIVATE))]
    with tempfile.TemporaryDirectory(prefix="dashred-seal-") as folder:
        private = Path(folder)
        asked = [word for word in argv if word.startswith("recording.")]
        recorder = _start(
            "record", [*words, *asked, f"twin={config.recording.twin}", f"output={private}"]
        )
        # The store's schema takes seconds to create: time that the recorder needs anyway.
        open_store(config.tracking.root, experiment)
        if code := recorder.wait():
            return code
        name = f"{config.name} seed {config.seed}"
        with Tracker.open(config.tracking.root, experiment, name) as run:
            output = Path(config.output) if config.output else run.artifact_dir
            output.mkdir(parents=True, exist_ok=True)
            shutil.copyfile(private / "recording.nc", output / "recording.nc")
            recording = f"recording.path={output / 'recording.nc'}"
            handed = [*words, recording, f"output={output}", f"tracking.run={run.run_id}"]
            if code := _start("train", handed).wait():
                return code
            store = [
                f"root={config.tracking.root}",
                f"experiment={experiment}",
                f"run={run.run_id}",
            ]
            sealed = private / "sealed.nc"
            if code := _start("score", [f"findings={output}", f"sealed={sealed}", *store]).wait():
                return code
            shutil.copyfile(sealed, output / "sealed.nc")
    return DONE


def _start(entry: str, words: list[str]) -> subprocess.Popen[bytes]:
    return subprocess.Popen([sys.executable, "-m", f"dashred.{entry}", *words])
