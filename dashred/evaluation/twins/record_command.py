"""Record a twin experiment: ``dashred record conf=rde twin=a output=DIR``.

Writes ``recording.nc`` (sensor values only) and ``sealed.nc`` (the truth) into DIR. The truth runs
at doubled resolution and half the step, from a start drawn from the prior. Its random stream is
keyed by the law itself, so that the analysis cannot derive it.
"""

from __future__ import annotations

import hashlib
import json
from dataclasses import asdict, replace
from pathlib import Path
from typing import TYPE_CHECKING

from dashred.config import Config, load_config
from dashred.core.errors import InputError

if TYPE_CHECKING:
    from dashred.data.recording import Recording
    from dashred.evaluation.twins.sealing import Truth
    from dashred.evaluation.twins.twin_file import Twin
    from dashred.physics.system import System


def main(argv: list[str]) -> int:
    """Record one twin."""
    config = load_config(argv, entry="record")
    if config.recording.twin is None or config.output is None:
        raise InputError("twin=NAME and output=DIR are needed", where="command line")
    record(config, Path(config.output))
    return 0


def record(config: Config, output: Path) -> None:
    """Simulate the truth, observe it with noisy sensors, and seal it.

    Raises:
        InputError: as :func:`record_twin`.
    """
    from dashred.data.io.write_netcdf import write_netcdf
    from dashred.evaluation.twins.sealing import seal
    from dashred.pipeline.run.output_dir import make_output

    recording, truth, system = record_twin(config)
    make_output(str(output))
    write_netcdf(recording, output / "recording.nc", [axis.name for axis in system.axes])
    seal(output / "sealed.nc", truth, system)


def record_twin(config: Config) -> tuple[Recording, Truth, System]:
    """Return what noisy sensors read of a twin, the truth, and the simulator.

    Raises:
        InputError: the twin is unknown, its law is not in the language, or the truth blows up.
    """
    import numpy as np
    import torch

    from dashred.core.progress import stage
    from dashred.core.threads import use_threads
    from dashred.data.inputs import drive_signals, with_inputs
    from dashred.evaluation.twins.recorder import observe, simulate_truth, truth_times
    from dashred.evaluation.twins.sealing import Truth
    from dashred.evaluation.twins.twin_file import read_twin
    from dashred.physics.system import System

    torch.set_num_threads(1)
    use_threads(config.threads)
    twin = read_twin(config)
    rng = np.random.default_rng(_random_key(twin, config.seed))
    times = truth_times(config)
    system = System(config.system, config.where)
    inputs = drive_signals(system, config, times)
    system = with_inputs(system, inputs)
    with stage("record the hidden truth") as report, torch.no_grad():
        states = simulate_truth(system, twin, config, times, rng, lambda done: report(done, ""))
        count = int((times <= config.recording.duration * (1 + 1e-9)).sum())
        read = observe(system, states[:count], times[:count], twin, config, rng)
        recording = replace(read, inputs=inputs, units=system.units)
    duration = config.recording.duration
    truth = Truth(twin.name, twin.terms, times, duration, states, twin.concealed)
    return recording, truth, system


def _random_key(twin: Twin, seed: int) -> int:
    from dashred.evaluation.twins.sealing import Concealed

    plain = asdict(twin)
    # Twins that hide only a law keep the stream that they had before other causes could be hidden.
    for term in plain["terms"]:
        if term["window"] is None:
            del term["window"]
    if twin.concealed == Concealed():
        del plain["concealed"]
    text = json.dumps({"twin": plain, "seed": seed}, sort_keys=True)
    return int.from_bytes(hashlib.sha256(text.encode()).digest())
