"""PDE-FIND on the full field of the truth, which no analysis has."""

from __future__ import annotations

import time
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np
import torch

from dashred.data.inputs import with_inputs
from dashred.data.io.reader import read_recording
from dashred.evaluation.baselines.analyse import failure_text
from dashred.evaluation.comparison.pde_find import pde_find
from dashred.evaluation.twins.scoring import system_of
from dashred.physics.terms.library import build_library


def pde_find_on_full_field(
    findings: Mapping[str, Any],
    folder: Path,
    fields: Sequence[str],
    times: np.ndarray,
    real: np.ndarray,
    noise: float,
    seed: int,
) -> dict[str, Any]:
    """Return the result of PDE-FIND in the form of the other methods.

    Args:
        findings: findings with the system, its library and its parameters.
        folder: folder of the recording, for its inputs.
        fields: names of the fields, in the order of the true states.
        times: times of the fit window, ``(time,)``.
        real: the true states, ``(time, field, *grid)``.
        noise: std of the added noise, as a share of that of each field.
        seed: seed of the noise.
    """
    plain = system_of(findings)
    system = with_inputs(plain, read_recording(str(folder / "recording.nc"), None, plain).inputs)
    library = build_library(system, findings["input"]["config"]["library"])
    ordered = torch.from_numpy(real[:, [fields.index(field) for field in system.fields]])
    rng = np.random.default_rng([seed, *b"full field"])
    started = time.perf_counter()
    terms, failed = None, None
    try:
        terms = pde_find(system, library, torch.tensor(times), ordered, noise, rng)
    except Exception as error:
        failed = failure_text(error)
    return {
        "seconds": time.perf_counter() - started,
        "terms": terms,
        "note": "",
        "failed": failed,
    }
