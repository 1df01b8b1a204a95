"""The states in which a law acts, as a threshold on a field that bounds most of its power."""

from __future__ import annotations

from collections.abc import Collection, Iterator

import torch
from torch import Tensor

from dashred.core.findings.law_schema import ActiveStates
from dashred.physics.system import System

# Share of the power within the threshold.
CARRIED = 0.8
# A law acts everywhere if that share of its power takes more than this share of the points.
EVERYWHERE = 0.5
# A field must have its rarer sign at this share of the points before thresholds on |u| are tried.
EITHER_SIGN = 0.1
# The precision of a threshold, as a share of the field's standard deviation.
PRECISION = 0.1


def active_states(
    system: System, states: Tensor, power: Tensor, read: Collection[str]
) -> ActiveStates | None:
    """Return the states with most of the power of a law; None if it acts everywhere.

    The thresholds are ``u > c`` and ``u < c``, and ``|u| > c`` and ``|u| < c`` for fields with both
    signs. Of all thresholds that contain 80 % of the power, the result has the fewest points.

    Args:
        system: the system with these fields.
        states: a trajectory, ``(time, field, *grid)``.
        power: squared tendency of the law, ``(time, *grid)``.
        read: the fields that the law depends on, which are tried; all fields if it is empty.
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
    """Yield a field name, whether the values are magnitudes, and the values at all points."""
    for index, field in enumerate(system.fields):
        if field not in read:
            continue
        values = states[:, index].flatten().double()
        yield field, False, values
        negative = float((values < 0).double().mean())
        if EITHER_SIGN < negative < 1 - EITHER_SIGN:
            yield field, True, values.abs()


def _smallest(values: Tensor, weights: Tensor, above: bool) -> tuple[float, float]:
    """Return the smallest share of points beyond a threshold with 80 % of the power, and it."""
    order = values.argsort(descending=above, stable=True)
    carried = weights[order].cumsum(dim=0)
    index = int(torch.searchsorted(carried, CARRIED * carried[-1]))
    index = min(index, len(values) - 1)
    return (index + 1) / len(values), float(values[order[index]])
