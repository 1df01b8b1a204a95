"""The tendency that a reported law adds along the true trajectory."""

from __future__ import annotations

import dataclasses
from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np
import torch

from dashred.core.errors import InputError
from dashred.evaluation.foreign.cases.case import Array, Truth
from dashred.physics.system import System, Term
from dashred.physics.terms.library import evaluate_terms


def added_tendencies(
    system: System, entries: Sequence[Mapping[str, Any]], truth: Truth
) -> list[Array] | None:
    """Return what each entry of a law adds, ``(time, field, *grid)``; None if it is not finite.

    Args:
        system: the simulator.
        entries: terms and parameter changes, as in ``findings.json``.
        truth: with the states and their times.
    """
    try:
        added = [
            _parameter(system, entry, truth)
            if entry["equation"] is None
            else _term(system, entry, truth)
            for entry in entries
        ]
    except (InputError, KeyError, ArithmeticError, TypeError, ValueError):
        return None
    return added if all(np.isfinite(each).all() for each in added) else None


def region_mask(system: System, region: Mapping[str, Any], truth: Truth) -> Array:
    """Return 1 inside of a told region and 0 outside, ``(time, *grid)``.

    A box on a periodic axis may run across its seam, also beyond the stated range.
    """
    shape = (len(truth.times), *truth.states.shape[2:])
    if "field" in region:
        values = truth.states[:, list(system.fields).index(region["field"])]
        inside = values > region["above"] if "above" in region else values < region["below"]
        return inside.astype(np.float64)
    if region["axis"] == "t":
        late = truth.times >= (region.get("from") or -np.inf)
        early = truth.times <= (region.get("to") or np.inf)
        inside = (late & early).reshape(-1, *(1,) * (len(shape) - 1))
        return np.array(np.broadcast_to(inside, shape), dtype=np.float64)
    box = float(region["from"]), float(region["to"])
    return np.array(np.broadcast_to(box_mask(system, region["axis"], box), shape))


def box_mask(system: System, axis: str, box: tuple[float, float]) -> Array:
    """Return 1 inside of a box along an axis and 0 outside, broadcastable to ``(*grid,)``."""
    names = [each.name for each in system.axes]
    position = names.index(axis)
    length = float(system.axes[position].length)
    points = system.grid.shape[position]
    places = np.arange(points) * length / points
    # The end may be smaller than the beginning, across the seam.
    width = (box[1] - box[0]) % length or length
    inside = (places - box[0]) % length <= width
    shape = [1] * len(names)
    shape[position] = points
    return inside.astype(np.float64).reshape(shape)


def _term(system: System, entry: Mapping[str, Any], truth: Truth) -> Array:
    equation = str(entry["equation"])
    term = Term(equation, system.parse(str(entry["term"]), "terms", equation=equation))
    added = np.zeros_like(truth.states)
    column = float(entry["coefficient"]) * _evaluate(system, [term], truth)[0]
    for region in entry.get("region") or ():
        column = column * region_mask(system, region, truth)
    added[:, list(system.fields).index(equation)] = column
    return added


def _parameter(system: System, entry: Mapping[str, Any], truth: Truth) -> Array:
    parameters = system.config.parameters | {str(entry["parameter"]): float(entry["to"])}
    changed = system.with_config(dataclasses.replace(system.config, parameters=parameters))
    return _rates(changed, truth) - _rates(system, truth)


def _rates(system: System, truth: Truth) -> Array:
    terms = [Term(name, system.equations[name]) for name in system.fields]
    return np.ascontiguousarray(_evaluate(system, terms, truth).swapaxes(0, 1))


def _evaluate(system: System, terms: Sequence[Term], truth: Truth) -> Array:
    """Return the terms along the true trajectory, ``(term, time, *grid)``."""
    states, times = torch.from_numpy(truth.states), torch.from_numpy(truth.times)
    return np.asarray(evaluate_terms(system, terms, states, times).numpy())
