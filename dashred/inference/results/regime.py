"""The states in which a law acts: beyond the threshold of a field that bounds most of its power."""

from __future__ import annotations

from collections.abc import Collection, Iterator

import torch
from torch import Tensor

from dashred.core.findings.law_schema import ActiveStates
from dashred.physics.system import System

CARRIED = 0.8
# A law whose power needs more than this of the domain acts everywhere.
EVERYWHERE = 0.5
# A field must be on its minority side so often before its size |u| is a regime of its own.
EITHER_SIGN = 0.1
# The precision of a threshold, as a share of the field's standard deviation.
PRECISION = 0.1


def active_states(
    system: System, states: Tensor, power: Tensor, read: Collection[str]
) -> ActiveStates | None:
    """Return the states that carry most of a law's power; None if it acts everywhere.

    Of all thresholds ``u > c``, ``u < c`` (and ``|u| > c``, ``|u| < c`` of fields with either
    sign) that bound points with 80 % of the power, the one with the fewest points is taken.

    Args:
        system: names the fields.
        states: a trajectory, ``(time, field, *grid)``.
        power: squared tendency of the law at its points, ``(time, *grid)``.
        read: the fields that the law reads, whose thresholds are tried; all, if it reads none.
    """
    weights = power.flatten()
    if not weights.any():
        return None
    found = [
        (*_smallest(values, weights, above), field, magnitude, above, float(values.std()))
        for field, magnitude, values in _quantities(system, states, set(read) or set(system.fields))
        for above in (True, False)
    ]
    share, threshold, field, magnitude, above, spread = min(found, key=lambda item: item[0])
    if share > EVERYWHERE:
        return None
    active = ActiveStates(
        field=field,
        magnitude=magnitude,
        precision=PRECISION * spread,
        share=share,
        carried=CARRIED,
    )
    active["above" if above else "below"] = threshold
    return active


def _quantities(
    system: System, states: Tensor, read: Collection[str]
) -> Iterator[tuple[str, bool, Tensor]]:
    """Yield field, whether it is its magnitude, and the values at all points."""
    for index, field in enumerate(system.fields):
        if field not in read:
            continue
        values = states[:, index].flatten().double()
        yield field, False, values
        negative = float((values < 0).double().mean())
        if EITHER_SIGN < negative < 1 - EITHER_SIGN:
            yield field, True, values.abs()


def _smallest(values: Tensor, weights: Tensor, above: bool) -> tuple[float, float]:
    """Return the smallest share of points on one side of a threshold with 80 %, and it."""
    order = values.argsort(descending=above, stable=True)
    carried = weights[order].cumsum(dim=0)
    index = int(torch.searchsorted(carried, CARRIED * carried[-1]))
    index = min(index, len(values) - 1)
    return (index + 1) / len(values), float(values[order[index]])
