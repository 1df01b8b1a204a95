"""Tendencies of candidates along a simulation, as columns to be compared."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property

import torch
from torch import Tensor

from dashred.physics.runs.tendency_size import program_slopes
from dashred.physics.system import System, Term
from dashred.physics.terms.library import evaluate_terms


@dataclass(frozen=True)
class Columns:
    """Tendencies of all candidates.

    Attributes:
        values: in units of each field, ``(candidate, field, time, point)``; 0 where unknown.
        known: 1 at the states at which they are known, else 0, ``(candidate, time)``.
    """

    values: Tensor
    known: Tensor

    @classmethod
    def of(cls, terms: Sequence[Tensor], effects: Mapping[int, Tensor], every: int) -> Columns:
        """Join the tendencies of terms and the effects of parameters of a program.

        Args:
            terms: of each candidate, ``(field, time, point)``.
            effects: by candidate, ``(field, probed time, point)``.
            every: distance of the states at which the program was asked.
        """
        values = torch.stack([*terms])
        known = torch.ones(values.shape[0], values.shape[2], dtype=torch.float64)
        for j, effect in effects.items():
            joined = values[j, :, ::every] + effect
            values[j], known[j] = 0.0, 0.0
            values[j, :, ::every], known[j, ::every] = joined, 1.0
        return cls(values, known)

    @cached_property
    def sizes(self) -> Tensor:
        """Norm of each, ``(candidate,)``."""
        return self.values.flatten(1).norm(dim=1)

    @cached_property
    def _squares(self) -> Tensor:
        return self.values.square().sum(dim=(1, 3))

    def scale(self, j: int) -> float:
        """Return the coefficient at which a candidate has the rms tendency of its equation."""
        size, count = float(self.sizes[j]), float(self.known[j].sum()) * self.values.shape[3]
        return math.sqrt(count) / size if size > 0 else math.inf

    def cosines(self, j: int, others: Sequence[int]) -> Tensor:
        """Return the cosines to other candidates, where both are known, ``(other,)``."""
        norms = (self._squares[others] @ self.known[j]) * (self.known[others] @ self._squares[j])
        products = self.values[others].flatten(1) @ self.values[j].flatten()
        return products.abs() / norms.sqrt()


def term_column(
    system: System, terms: Sequence[Term], states: Tensor, t: float | Tensor, rms: Tensor
) -> Tensor:
    """Return the tendency of terms, in units of the rms tendency of each equation.

    Args:
        system: the simulator.
        terms: resolved.
        states: ``(time, field, *grid)``.
        t: time of all states, or of each, ``(time,)``.
        rms: of the tendency of each equation, ``(field,)``.

    Returns:
        ``(field, time, point)``.
    """
    return in_units(term_rates(system, terms, states, t), rms)


def in_units(rates: Tensor, rms: Tensor) -> Tensor:
    """Return rates ``(time, field, *grid)`` in units of each field, ``(field, time, point)``."""
    points = rates.reshape(*rates.shape[:2], -1).transpose(0, 1)
    return points / rms[:, None, None]


def term_rates(system: System, terms: Sequence[Term], states: Tensor, t: float | Tensor) -> Tensor:
    """Return the tendency of terms, ``(batch, field, *grid)``."""
    rates = torch.zeros_like(states, dtype=torch.float64)
    if terms:
        found = evaluate_terms(system, terms, states, t)
        for term, values in zip(terms, found, strict=True):
            rates[:, system.fields.index(term.equation)] += values
    return rates


def program_effects(
    system: System, names: Sequence[str], states: Tensor, t: float | Tensor
) -> dict[str, Tensor]:
    """Return the tendencies ``(time, field, *grid)`` of the parameters that a program reads.

    Args:
        system: with a program.
        names: of the parameters.
        states: ``(time, field, *grid)``.
        t: time of all states, or of each, ``(time,)``.
    """
    if not names:
        return {}
    # The program may fail at some states.
    effects = program_slopes(system, states, t, names).nan_to_num(nan=0.0)
    return {name: effect for name, effect in zip(names, effects, strict=True) if effect.any()}
