"""Make a case's recording: size what is hidden by its effect on the sensors, and read the truth.

The truth stays in memory until the findings are frozen: while a case is analysed, it is on no disk.
"""

from __future__ import annotations

from dataclasses import dataclass

import torch

from dashred.config import Config, load_config
from dashred.core.errors import InputError
from dashred.data.recording import Recording
from dashred.evaluation.proof.cases.draw import Case
from dashred.evaluation.proof.cases.sizes import Sizes
from dashred.evaluation.twins.recorder import observe, run_truth, with_law
from dashred.evaluation.twins.sealing import Truth
from dashred.physics.system import System

# How often what blows up is halved.
RETREATS = 6


@dataclass(frozen=True)
class Concealed:
    """A recorded case, and what nobody may know yet.

    Attributes:
        config: of the system, as it was recorded.
        system: the simulator.
        recording: what the analysis is handed.
        truth: what it is not.
        effect: rms of what is hidden over the sensors, in units of the noise; None where nothing
            was to be sized.
        numerics: what the simulator's own numerical error adds to χ²: its run from the true start
            under the true law, against the truth at doubled resolution.
    """

    config: Config
    system: System
    recording: Recording
    truth: Truth
    effect: float | None
    numerics: float


@torch.no_grad()
def conceal(case: Case) -> Concealed:
    """Record one case.

    Raises:
        InputError: the truth blows up, however small.
    """
    words = [f"conf={case.system}", "twin=null", f"seed={case.analysis_seed}"]
    words += [f"recording.noise={case.noise:g}", f"recording.sensors={case.sensors}"]
    config = load_config(words, entry="record")
    system = System(config.system, config.where)
    sizes = Sizes.of(case, system, config)
    size, effect = 0.0, None
    if case.effect is not None and (case.hidden["terms"] or "parameters" in case.hidden):
        size, effect = sizes.fitting_size(case)
    for _ in range(RETREATS):
        twin = sizes.twin(sizes.sized(case.hidden, size))
        try:
            states = run_truth(with_law(system, twin), sizes.start, sizes.times)
            break
        except InputError:
            # Within the record it was well: it blows up where only forecasts go.
            size /= 2
            effect = sizes.effect(case.hidden, size)
    else:
        raise InputError("what was to be hidden blows the simulator up")
    count = sizes.recorded
    recording = observe(
        system, states[:count], sizes.times[:count], twin, config, case.stream("read")
    )
    duration = config.recording.duration
    truth = Truth(str(case), twin.terms, sizes.times, duration, states, twin.concealed)
    numerics = sizes.numerical_error(with_law(system, twin), states[:count])
    return Concealed(config, system, recording, truth, effect, numerics)
