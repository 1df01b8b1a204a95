"""PDE-FIND on what nobody has, the full field of the truth: more than any sensors could tell."""

from __future__ import annotations

import time
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np
import torch

from dashred.data.inputs import with_inputs
from dashred.data.io.reader import read_recording
from dashred.evaluation.baselines.analyse import own_failure
from dashred.evaluation.comparison.pde_find import pde_find
from dashred.evaluation.twins.scoring import system_of
from dashred.physics.library import build_library


def pde_find_on_full_field(
    findings: Mapping[str, Any],
    folder: Path,
    fields: Sequence[str],
    times: np.ndarray,
    real: np.ndarray,
    noise: float,
    seed: int,
) -> dict[str, Any]:
    """Return how PDE-FIND ended, in the form of the other methods.

    Args:
        findings: name the system, its library and its parameters.
        folder: of the recording, for its inputs.
        fields: in the order of the true states.
        times: of the fit window, ``(time,)``.
        real: the truth's states, ``(time, field, *grid)``.
        noise: std of what is added, as a share of each field's.
        seed: of that noise.
    """
    plain = system_of(findings)
    system = with_inputs(plain, read_recording(str(folder / "recording.nc"), None, plain).inputs)
    library = build_library(system, findings["input"]["config"]["library"])
    ordered = torch.from_numpy(real[:, [fields.index(field) for field in system.fields]])
    rng = np.random.default_rng([seed, *b"full field"])
    began = time.perf_counter()
    terms, failed = None, None
    try:
        terms = pde_find(system, library, torch.tensor(times), ordered, noise, rng)
    except Exception as error:
        failed = own_failure(error)
    return {
        "seconds": time.perf_counter() - began,
        "terms": terms,
        "note": "",
        "failed": failed,
    }
