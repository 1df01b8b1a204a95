"""The folder for arrays of a run that do not fit into memory."""

from __future__ import annotations

import hashlib
import json
from pathlib import Path

from dashred.config import Config, config_sha256
from dashred.core.files.scratch import Scratch
from dashred.core.files.state_dir import state_path
from dashred.core.mlflow.store_address import is_server
from dashred.pipeline.run.run_manifest import manifest_of

# Folder in the output folder, or in the MLflow store.
NAME = ".ensembles"
# Digits of the hash that tells runs in one store from one another.
DIGITS = 16


def scratch_of(config: Config, recording_sha256: str) -> Scratch:
    """Return the scratch of a run; it creates no folder before one is used.

    It is in the output folder if that is named. Otherwise it is in the folder of the MLflow store,
    or, if that is a server, in the user's state folder.
    """

    def identity() -> str:
        return json.dumps(manifest_of(config, recording_sha256))

    if config.output:
        return Scratch(Path(config.output) / NAME, identity)
    text = config_sha256(config) + recording_sha256
    own = hashlib.sha256(text.encode()).hexdigest()[:DIGITS]
    if is_server(config.tracking.root):
        return Scratch(state_path("ensembles", own), identity)
    return Scratch(Path(config.tracking.root) / f"{NAME}-{own}", identity)
