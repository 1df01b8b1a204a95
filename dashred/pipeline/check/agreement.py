"""Whether simulator and recording speak of the same thing: its size, and where it begins."""

from __future__ import annotations

from collections.abc import Iterator

import torch
from torch import Tensor

from dashred.data.observation_operator import ObservationOperator
from dashred.data.splits import Split
from dashred.pipeline.check.context import CheckContext
from dashred.pipeline.check.observability import Seen
from dashred.pipeline.check.placeholders import still
from dashred.pipeline.check.remark import Remark, doubtful, some
from dashred.pipeline.check.simulator import Simulated

# Factors by which what is read and what is simulated may differ in size.
OTHER_SIZE = 5.0
# Standard deviations that the first sample may lie from where the simulator begins.
FAR = 4.0


@torch.no_grad()
def about_agreement(
    situation: CheckContext, simulated: Simulated, seen: Seen | None
) -> Iterator[Remark]:
    """Compare the simulator's readings with the recording's, up to the end of the fit window."""
    if situation.recording is None:
        return
    fit = situation.split.fit
    count = min(len(fit.times), len(simulated.times))
    values = torch.from_numpy(fit.values[:count])
    operator = ObservationOperator(fit.sensors, situation.system)
    read = operator(simulated.states[:count])
    if not still(situation.config):
        yield from sizes_compared(fit.names, values, read, "simulator")
    if seen is not None:
        yield from _beginning(situation, simulated, seen)


def sizes_compared(
    names: tuple[str, ...], values: Tensor, read: Tensor, where: str
) -> Iterator[Remark]:
    """Compare how much sensors vary with how much they would in a simulation.

    Args:
        names: of the sensors.
        values: what they recorded, ``(time, sensor)``; NaN is missing.
        read: what they would read, ``(sample, sensor)``.
        where: simulator or snapshots.
    """
    both = [_std(column) for column in values.T], [_std(column) for column in read.T]
    ratios = {n: r / max(s, 1e-300) for n, r, s in zip(names, *both, strict=True) if s > 0}
    off = [name for name, ratio in ratios.items() if not 1 / OTHER_SIZE < ratio < OTHER_SIZE]
    if off:
        yield doubtful(
            f"What {some(off)} read varies {ratios[off[0]]:.2g} times as much as in the {where}",
            "are both in the same unit (rad or degrees, s or ms)?",
        )
    elif ratios:
        typical = sorted(ratios.values())[len(ratios) // 2]
        yield Remark(f"The sensors vary {typical:.2g} times as much as in the {where}")


def _beginning(situation: CheckContext, simulated: Simulated, seen: Seen) -> Iterator[Remark]:
    """Hold first samples against the start's prior: ``y₀ − Hm`` over ``√(σ² + HBBᵀHᵀ)``."""
    assert situation.problem is not None
    sensors = situation.sensors
    read = ObservationOperator(sensors, situation.system)(simulated.states[0])
    sigma = situation.sigma(simulated.states)
    spread = (seen.sensitivity[: len(sensors)].square().sum(dim=1) + 1).sqrt() * sigma
    episodes = situation.problem.episodes
    fits = True
    for episode in episodes:
        first = _first_sample(episode.split)
        far = [
            sensor.name
            for sensor, was, size in zip(sensors, read.tolist(), spread.tolist(), strict=True)
            if sensor.name in first and abs(first[sensor.name] - was) > FAR * size
        ]
        fits = fits and bool(first) and not far
        if far:
            which = f" of episode {episode.name!r}" if len(episodes) > 1 else ""
            yield doubtful(
                f"The first sample{which} lies more than {FAR:g} standard deviations from the "
                f"simulator's start: {some(far)}",
                "give the start that it has, or more system.spread",
            )
    if fits:
        each = "The first sample lies" if len(episodes) == 1 else "Every first sample lies"
        yield Remark(f"{each} where the start may be")


def _first_sample(split: Split) -> dict[str, float]:
    """Return what the sensors that a fit may look at read first, by name."""
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
