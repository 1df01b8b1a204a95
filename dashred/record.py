"""Let a hidden truth make a recording: ``python -m dashred.record conf=rde twin=a output=DIR``.

Writes ``recording.nc`` (sensor values alone) and ``sealed.nc`` (the truth) into DIR. The truth
runs at doubled resolution and half the step, from a start drawn from the prior; its random
stream is keyed by the law itself, so that the analysis could not derive it if it tried.
"""

from __future__ import annotations

import hashlib
import json
import math
import sys
from dataclasses import asdict
from pathlib import Path
from typing import TYPE_CHECKING

from dashred.config import Config, load_config
from dashred.errors import InputError, run_entry

if TYPE_CHECKING:
    import numpy as np
    from torch import Tensor

    from dashred.physics.algebra import Expr
    from dashred.physics.simulate import Progress
    from dashred.physics.system import System
    from dashred.sealing import SealedTerm
    from dashred.sensing.recording import Recording
    from dashred.sensing.sensors import Sensor
    from dashred.twin_file import Twin

FORECAST = 1.5


def main(argv: list[str]) -> int:
    """Record one twin."""
    config = load_config(argv, entry="record")
    if config.recording.twin is None or config.output is None:
        raise InputError("twin=NAME and output=DIR are needed", where="command line")
    record(config, Path(config.output))
    return 0


def record(config: Config, output: Path) -> None:
    """Simulate the truth, read it with noisy sensors, seal it.

    Raises:
        InputError: the twin is unknown, its law is not in the language, or the truth blows up.
    """
    import numpy as np
    import torch

    from dashred.output import make_output
    from dashred.physics.side_by_side import use_threads
    from dashred.physics.system import System
    from dashred.progress import stage
    from dashred.sealing import Truth, seal
    from dashred.sensing.write_netcdf import write_netcdf
    from dashred.twin_file import read_twin

    torch.set_num_threads(1)
    use_threads(config.threads)
    twin = read_twin(config)
    rng = np.random.default_rng(_key(twin, config.seed))
    system = System(config.system, config.where)
    with stage("record the hidden truth") as report, torch.no_grad():
        times, states = simulate_truth(system, twin, config, rng, lambda done: report(done, ""))
        count = int((times <= config.recording.duration * (1 + 1e-9)).sum())
        recording = observe(system, states[:count], times[:count], twin, config, rng)
    make_output(str(output))
    write_netcdf(recording, output / "recording.nc", [axis.name for axis in system.axes])
    duration = config.recording.duration
    truth = Truth(twin.name, twin.terms, times, duration, states, twin.concealed)
    seal(output / "sealed.nc", truth, system)


def simulate_truth(
    system: System, twin: Twin, config: Config, rng: np.random.Generator, progress: Progress | None
) -> tuple[Tensor, Tensor]:
    """Return times ``(time,)`` and the truth ``(time, field, *grid)`` on the simulator's grid."""
    import torch

    from dashred.discovery.correction import with_parameters
    from dashred.discovery.starts import ScaledStart
    from dashred.physics.prior import StartPrior, field_rms, nominal_start, spread_in_percent
    from dashred.physics.simulate import check_finite, simulate
    from dashred.physics.system import Term

    law = [(Term(t.equation, expression_of(system, t)), t.coefficient) for t in twin.terms]
    lawful = with_parameters(system, twin.concealed.parameters).with_terms(law)
    every = config.recording.every
    assert every is not None
    samples = round(FORECAST * config.recording.duration / every)
    times = torch.arange(samples + 1, dtype=torch.float64) * every
    centre = nominal_start(lawful if twin.own_start else system)
    rms = torch.ones(len(system.fields), dtype=torch.float64)
    if spread_in_percent(system):
        nominal = simulate(system, centre, times[times <= config.recording.duration])
        rms = field_rms(nominal[0])
    truth = lawful.refined()
    fine_centre = system.grid.interpolate(centre, truth.grid) if system.axes else centre
    prior = StartPrior(truth, fine_centre[0], rms, None)
    start = ScaledStart(prior, twin.concealed.spread).draw(1, rng)
    path = simulate(truth, start, times, progress=progress)
    check_finite(path, times, truth)
    coarse = path[0]
    for dim in range(2, coarse.dim()):
        coarse = coarse[(slice(None),) * dim + (slice(None, None, 2),)]
    return times, coarse.contiguous()


def expression_of(system: System, term: SealedTerm) -> Expr:
    """Return a true term with its window, in the equation language."""
    from dashred.physics.algebra import multiply
    from dashred.physics.window import box, gate, onset

    expression = system.parse(term.term, "recording.twin", equation=term.equation)
    if term.window is None:
        return expression
    of, begin, end, edge = term.window
    axes = {axis.name: axis for axis in system.axes}
    width = math.log(edge)
    if of in axes:
        assert begin is not None and end is not None
        window = box(axes[of]).at(((begin + end) / 2, (end - begin) / 2, width))
    elif of == "t":
        assert begin is not None
        window = onset().at((begin, width))
    elif begin is not None:
        window = gate(of, 1).at((begin, width))
    else:
        assert end is not None
        window = gate(of, -1).at((end, width))
    return multiply((window.expression, expression))


def observe(
    system: System,
    states: Tensor,
    times: Tensor,
    twin: Twin,
    config: Config,
    rng: np.random.Generator,
) -> Recording:
    """Read the truth at random places, with noise of a fraction of each quantity's std."""
    import numpy as np

    from dashred.sensing.faulty import correlated, moved, reported
    from dashred.sensing.observation import ObservationOperator
    from dashred.sensing.recording import Recording

    places, hidden = place_sensors(system, config, rng), twin.concealed
    real = [moved(sensor, hidden.faults, system) for sensor in places]
    clean = ObservationOperator(real, system)(states).numpy()
    noisy, sensors = np.empty_like(clean), []
    for column, sensor in enumerate(places):
        whole = system.evaluate(sensor.reads, states)
        std = config.recording.noise * float(whole.std())
        noise = std * correlated(rng.standard_normal(len(times)), hidden.correlation)
        read = clean[:, column] + noise
        noisy[:, column] = reported(read, times.numpy(), sensor, hidden.faults)
        stated = std * twin.stated if std > 0 else None
        sensors.append(type(sensor)(sensor.name, sensor.reads, sensor.position, stated))
    return Recording(tuple(sensors), times.numpy(), noisy)


def place_sensors(system: System, config: Config, rng: np.random.Generator) -> list[Sensor]:
    """Draw places for the fit sensors, and for the validation and test sensors on top.

    Each place is the best of 20 random ones, so that sensors keep a distance but no pattern.
    An ODE system has no places: its sensors read their quantities, over and over.
    """
    import numpy as np

    from dashred.sensing.sensors import Sensor
    from dashred.sensing.spreading import spread_out

    count, reads = config.recording.sensors, config.recording.reads
    if not isinstance(count, int):
        raise InputError("a twin's sensors are a number", where=config.where("recording.sensors"))
    if not system.axes:
        return [Sensor(_name(i, count), reads[i % len(reads)], (), None) for i in range(count)]
    for role in ("validate", "test"):
        extra = getattr(config.splits.sensors, role)
        count += extra if isinstance(extra, int) else len(extra)
    lengths = np.array([axis.length for axis in system.axes])
    candidates = rng.random((20 * count, len(lengths))) * lengths
    chosen = spread_out(candidates, count, rng, candidates=range(len(candidates)))
    order = sorted(tuple(candidates[i].tolist()) for i in chosen)
    return [
        Sensor(_name(i, count), reads[i % len(reads)], place, None) for i, place in enumerate(order)
    ]


def _name(index: int, count: int) -> str:
    return f"s{index + 1:0{len(str(count))}d}"


def _key(twin: Twin, seed: int) -> int:
    from dashred.sealing import Concealed

    plain = asdict(twin)
    # What conceals no more than a law keeps the stream that it had before there was more.
    for term in plain["terms"]:
        if term["window"] is None:
            del term["window"]
    if twin.concealed == Concealed():
        del plain["concealed"]
    text = json.dumps({"twin": plain, "seed": seed}, sort_keys=True)
    return int.from_bytes(hashlib.sha256(text.encode()).digest())


if __name__ == "__main__":
    sys.exit(run_entry(main))
