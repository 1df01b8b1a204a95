"""Record a case: scale the hidden effect by its size at the sensors, then observe the truth.

The truth stays in memory until the findings are frozen; it is not on disk during the analysis.
"""

from __future__ import annotations

from dataclasses import dataclass

import torch

from dashred.config import Config, load_config
from dashred.core.errors import InputError
from dashred.data.recording import Recording
from dashred.evaluation.proof.cases.draw import Case
from dashred.evaluation.proof.cases.sizes import Sizes
from dashred.evaluation.twins.recorder import observe, run_truth, true_system
from dashred.evaluation.twins.sealing import Truth
from dashred.physics.system import System

# Number of times that the size is halved if the truth blows up.
MAX_HALVINGS = 6


@dataclass(frozen=True)
class CaseTruth:
    """The recording of a case and its truth.

    Attributes:
        config: configuration of the recording.
        system: the simulator.
        recording: the recording that the analysis receives.
        truth: the truth, which it does not receive.
        effect: rms of the hidden effect at the sensors, in units of the noise; None if the effect
            was not scaled.
        numerics: χ² of the simulator's numerical error: its run with the true start and law
            against the truth at doubled resolution.
    """

    config: Config
    system: System
    recording: Recording
    truth: Truth
    effect: float | None
    numerics: float


@torch.no_grad()
def record_truth(case: Case) -> CaseTruth:
    """Simulate the truth of a case and record it.

    Raises:
        InputError: the truth blows up at every size.
    """
    words = [f"conf={case.system}", "twin=null", f"seed={case.analysis_seed}"]
    words += [f"recording.noise={case.noise:g}", f"recording.sensors={case.sensors}"]
    config = load_config(words, entry="record")
    system = System(config.system, config.where)
    sizes = Sizes.of(case, system, config)
    size, effect = 0.0, None
    if case.effect is not None and (case.hidden["terms"] or "parameters" in case.hidden):
        size, effect = sizes.fitting_size(case)
    for _ in range(MAX_HALVINGS):
        twin = sizes.twin(sizes.sized(case.hidden, size))
        try:
            states = run_truth(true_system(system, twin), sizes.start, sizes.times)
            break
        except InputError:
            # The truth is finite within the record but blows up later, in the time of forecasts.
            size /= 2
            effect = sizes.effect(case.hidden, size)
    else:
        raise InputError("the hidden effect makes the simulation blow up")
    count = sizes.recorded
    recording = observe(
        system, states[:count], sizes.times[:count], twin, config, case.stream("read")
    )
    duration = config.recording.duration
    truth = Truth(str(case), twin.terms, sizes.times, duration, states, twin.concealed)
    numerics = sizes.numerical_error(true_system(system, twin), states[:count])
    return CaseTruth(config, system, recording, truth, effect, numerics)
