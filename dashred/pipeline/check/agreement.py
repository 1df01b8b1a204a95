"""Compare the simulator with the recording: amplitudes and initial values."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence

import torch
from torch import Tensor

from dashred.data.observation_operator import ObservationOperator
from dashred.data.sensors import Sensor
from dashred.data.splits import Split
from dashred.pipeline.check.context import CheckContext
from dashred.pipeline.check.placeholders import zero_equations
from dashred.pipeline.check.remark import Remark, shortened, warning
from dashred.pipeline.check.simulator_checks.observability import Observability
from dashred.pipeline.check.simulator_checks.simulator import NominalRun

# Largest accepted ratio between recorded and simulated standard deviations, either way.
MAX_RATIO = 5.0
# Readings vary if their std is more than this many σ of their noise; simulated ones, if it is more
# than σ and this share of the largest one of the same quantity.
MOVED, NEGLIGIBLE = 1.5, 1e-3
# Factors between units that are easily confused, and how near a ratio is to one of them.
UNIT_FACTORS = {
    57.3: "rad and degrees",
    60.0: "minutes and seconds",
    1000.0: "m and mm, or s and ms",
    3600.0: "hours and seconds",
}
UNIT_TOLERANCE = 0.2
# Largest accepted distance of the first sample from the simulated one, in standard deviations.
MAX_DEVIATIONS = 4.0


@torch.no_grad()
def agreement_remarks(
    context: CheckContext, nominal: NominalRun, observed: Observability | None
) -> Iterator[Remark]:
    """Compare simulated with recorded readings, up to the end of the fit window."""
    if context.recording is None:
        return
    fit = context.split.fit
    count = min(len(fit.times), len(nominal.times))
    values = torch.from_numpy(fit.values[:count])
    operator = ObservationOperator(fit.sensors, context.system)
    read = operator(nominal.states[:count])
    if not zero_equations(context.config):
        yield from compare_amplitudes(fit.sensors, values, read, context.noise, "simulator")
    if observed is not None:
        yield from _start_agreement(context, nominal, observed)


def compare_amplitudes(
    sensors: Sequence[Sensor], values: Tensor, read: Tensor, noise: Mapping[str, float], where: str
) -> Iterator[Remark]:
    """Compare the standard deviations of recorded and simulated readings.

    Args:
        sensors: that were read.
        values: recorded values, ``(time, sensor)``; NaN where missing.
        read: simulated readings, ``(sample, sensor)``.
        noise: σ by sensor.
        where: "simulator" or "snapshots".
    """
    recorded, simulated = map(_std, values.T), [_std(column) for column in read.T]
    ratios: dict[str, float] = {}
    waiting: dict[bool, list[str]] = {True: [], False: []}
    is_read = (~values.isnan()).any(dim=0).tolist()
    for sensor, own, other, known in zip(sensors, recorded, simulated, is_read, strict=True):
        if not known:
            continue
        alike = (
            s for s, found in zip(simulated, sensors, strict=True) if found.reads == sensor.reads
        )
        moves = own > MOVED * noise[sensor.name]
        is_simulated = other > max(noise[sensor.name], NEGLIGIBLE * max(alike))
        if moves and is_simulated:
            ratios[sensor.name] = own / other
        elif moves or is_simulated:
            waiting[moves].append(sensor.name)
    if not any(s > 0 for s in simulated):
        return
    off = [name for name, ratio in ratios.items() if not 1 / MAX_RATIO < ratio < MAX_RATIO]
    if off:
        yield warning(
            f"Readings of {shortened(off)} vary {ratios[off[0]]:.2g} times as much as in the "
            f"{where}",
            _reason(ratios[off[0]]),
        )
    elif ratios:
        typical = sorted(ratios.values())[len(ratios) // 2]
        yield Remark(f"Sensor readings vary {typical:.2g} times as much as in the {where}")
    for is_recorded, names in waiting.items():
        if names:
            moved, still = ("recording", where) if is_recorded else (where, "recording")
            yield warning(
                f"Readings of {shortened(names)} vary in the {moved}, but not above the noise in "
                f"the {still}",
                "what moves them may come later there, or not at all: missing physics may be the "
                "reason; otherwise check system.start, the units and the positions",
            )


def _reason(ratio: float) -> str:
    """Return a likely reason for readings that vary more or less than simulated ones."""
    factor = max(ratio, 1 / ratio)
    for size, units in UNIT_FACTORS.items():
        if abs(factor / size - 1) < UNIT_TOLERANCE:
            return f"check that both use the same unit: {units} differ by this factor"
    return "missing physics may be the reason; otherwise check system.start and the units"


def _start_agreement(
    context: CheckContext, nominal: NominalRun, observed: Observability
) -> Iterator[Remark]:
    """Compare first samples with the prior of the start: ``y₀ − Hm`` over ``√(σ² + HBBᵀHᵀ)``."""
    assert context.problem is not None
    sensors = context.sensors
    read = ObservationOperator(sensors, context.system)(nominal.states[0])
    sigma = context.sigma(nominal.states)
    spread = (observed.sensitivity[: len(sensors)].square().sum(dim=1) + 1).sqrt() * sigma
    episodes = context.problem.episodes
    fits = True
    for episode in episodes:
        first = _first_sample(episode.split)
        far = [
            sensor.name
            for sensor, mean, size in zip(sensors, read.tolist(), spread.tolist(), strict=True)
            if sensor.name in first and abs(first[sensor.name] - mean) > MAX_DEVIATIONS * size
        ]
        fits = fits and bool(first) and not far
        if far:
            which = f" of episode {episode.name!r}" if len(episodes) > 1 else ""
            yield warning(
                f"The first sample{which} is more than {MAX_DEVIATIONS:g} standard deviations from "
                f"the simulator's initial state: {shortened(far)}",
                "correct system.start, or increase system.spread",
            )
    if fits:
        each = "The first sample is" if len(episodes) == 1 else "Every first sample is"
        yield Remark(f"{each} consistent with the prior of the initial state")


def _first_sample(split: Split) -> dict[str, float]:
    """Return the first reading of each fit or validation sensor, by name."""
    return {
        name: value
        for part in (split.fit, split.validation)
        if part.times[0] == split.fit.times[0]
        for name, value in zip(part.names, part.values[0].tolist(), strict=True)
        if value == value
    }


def _std(column: Tensor) -> float:
    known = column[~column.isnan()]
    return float(known.std()) if len(known) > 1 else 0.0
