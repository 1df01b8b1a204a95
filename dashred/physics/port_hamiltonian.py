"""Port-Hamiltonian systems: ``∂x/∂t = (J − R) δH/δx + G u``.

H is the energy, J = −Jᵀ exchanges it between fields, R = Rᵀ ⪰ 0 dissipates it, and G couples the
inputs u (van der Schaft & Jeltsema, Port-Hamiltonian systems theory, 2014, ch. 6).
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace
from functools import cached_property
from typing import Any, Literal

import torch
from torch import Tensor

from dashred.core.errors import InputError, nearest
from dashred.physics.expressions.algebra import (
    ZERO,
    Call,
    Derivative,
    Expr,
    Name,
    add,
    call,
    derivative,
    multiply,
    names,
    scale,
    substitute,
    to_text,
)
from dashred.physics.expressions.differentiate import differentiate
from dashred.physics.expressions.semilinear import (
    NotSemilinearError,
    SemilinearBuilder,
    apply_operator,
)
from dashred.physics.grids.quadrature import integral
from dashred.physics.sampled_states import SampledStates, evaluate, without_sides
from dashred.physics.system import System
from dashred.physics.system_schema import Structure

# Relative error below which two expressions are equal.
RELATIVE_TOLERANCE = 1e-8
Part = Literal["H", "J", "R", "G"]
Entries = dict[str, dict[str, Expr]]


@dataclass(frozen=True)
class PortHamiltonian:
    """The port-Hamiltonian structure of a system.

    Attributes:
        system: with the equations.
        structure: as declared.
        energy: H, or its density if there are axes, with lets and parameters substituted.
        interconnection: J by equation and field; missing entries are zero.
        dissipation: R by equation and field; missing entries are zero.
        ports: G by equation and input.
    """

    system: System
    structure: Structure
    energy: Expr
    interconnection: Entries
    dissipation: Entries
    ports: Entries

    @classmethod
    def of(cls, system: System, structure: Structure) -> PortHamiltonian:
        """Parse the structure of a system.

        Raises:
            InputError: an entry is invalid, or names an unknown field or input.
        """
        key = "system.structure"
        energy = system.resolve(system.parse(structure.H, f"{key}.H"), f"{key}.H")
        return cls(
            system,
            structure,
            energy,
            _entries(system, structure.J, "J", system.fields),
            _entries(system, structure.R, "R", system.fields),
            _entries(system, structure.G, "G", tuple(system.config.inputs)),
        )

    @cached_property
    def effort(self) -> dict[str, Expr]:
        """Effort ``δH/δx`` of every field."""
        return variational_derivative(self.system, self.energy)

    @cached_property
    def equations(self) -> dict[str, Expr]:
        """``(J − R) δH/δx + G u`` of every field."""
        found = {}
        for field in self.system.fields:
            terms = [multiply((e, self.effort[g])) for g, e in self._row("J", field).items()]
            lost = [multiply((e, self.effort[g])) for g, e in self._row("R", field).items()]
            ports = [multiply((e, Name(u))) for u, e in self._row("G", field).items()]
            found[field] = add([*terms, *(scale(-1.0, each) for each in lost), *ports])
        return found

    def check(self, at: SampledStates) -> None:
        """Check the structure against the equations.

        Args:
            at: states that are smooth in space.

        Raises:
            InputError: J or R is not finite, J is not skew-symmetric, R is not symmetric positive
                semi-definite, or the structure does not give the equations.
        """
        where = self.system.where
        for part, entries in (("J", self.interconnection), ("R", self.dissipation)):
            if not self._matrix(entries, at).isfinite().all():
                problem = f"{part} is not finite at states of the simulation"
                raise InputError(problem, where=where(f"system.structure.{part}"))
        if not self.is_skew(at):
            raise InputError("J is not skew-symmetric", where=where("system.structure.J"))
        dissipation = self._matrix(self.dissipation, at)
        if not close_fields(dissipation, dissipation.mT):
            raise InputError("R is not symmetric", where=where("system.structure.R"))
        if not _semidefinite(dissipation):
            problem = "R is not positive semi-definite: it would add energy"
            raise InputError(problem, where=where("system.structure.R"))
        own_points = self.system.grid.own
        for field, made in self.equations.items():
            own = without_sides(self.system.resolved[field], self.system)
            if not close_fields(*(own_points(evaluate(self.system, e, at)) for e in (made, own))):
                raise InputError(
                    f"the structure gives d({field})/dt = {to_text(made)}, but the equation is "
                    f"{to_text(own)}",
                    where=where("system.structure"),
                    hint="the equations are (J - R)*dH/dx + G*u",
                )

    def defined(self, at: SampledStates) -> SampledStates:
        """Return the states at which J, R and every effort are finite, such as ``√q`` at q ≥ 0."""
        values = [self._matrix(part, at) for part in (self.interconnection, self.dissipation)]
        values += [evaluate(self.system, effort, at) for effort in self.effort.values()]
        finite = torch.stack([each.isfinite().reshape(len(each), -1).all(dim=1) for each in values])
        there = finite.all(dim=0)
        return SampledStates(at.states[there], at.times[there])

    def is_skew(self, at: SampledStates) -> bool:
        """Return whether ``J = −Jᵀ`` at all states."""
        interconnection = self._matrix(self.interconnection, at)
        return close_fields(interconnection, -interconnection.mT)

    def dissipated_power(self, at: SampledStates, efforts: Mapping[str, Tensor]) -> Tensor:
        """Return the dissipated power ``∫ eᵀ R e``, ``(state,)``.

        Args:
            at: the states.
            efforts: e of every field at the states, ``(state, *grid)``.
        """
        taken = torch.zeros(len(at.states), dtype=torch.float64)
        for field, row in self.dissipation.items():
            for other, entry in row.items():
                rate = evaluate(self.system, entry, at) * efforts[other]
                taken = taken + integral(self.system.product_grid, efforts[field] * rate)
        return taken

    def parts_with_parameter(self, parameter: str) -> list[Part]:
        """Return the parts that depend on a parameter, directly or through a let."""
        structure, system = self.structure, self.system
        lets: dict[str, Expr] = {}
        for let, expr in system.lets.items():
            lets[let] = substitute(expr, lets)
        texts: dict[Part, list[str]] = {"H": [structure.H]}
        matrices: dict[Part, Any] = {"J": structure.J, "R": structure.R, "G": structure.G}
        for part, entries in matrices.items():
            texts[part] = [str(text) for row in entries.values() for text in row.values()]
        return [
            part
            for part, written in texts.items()
            if any(
                parameter in names(substitute(system.parse(text, "system.structure"), lets))
                for text in written
            )
        ]

    def with_parameters(self, changes: Mapping[str, float]) -> PortHamiltonian:
        """Return the structure with the given changes added to parameters."""
        config = self.system.config
        changed = {name: config.parameters[name] + change for name, change in changes.items()}
        system = self.system.with_config(replace(config, parameters=config.parameters | changed))
        return PortHamiltonian.of(system, self.structure)

    def _row(self, part: str, field: str) -> dict[str, Expr]:
        entries = {"J": self.interconnection, "R": self.dissipation, "G": self.ports}[part]
        return entries.get(field, {})

    def _matrix(self, entries: Entries, at: SampledStates) -> Tensor:
        """Return a matrix at every point, ``(state, *grid, field, field)``."""
        fields = self.system.fields
        rows = []
        for field in fields:
            row = entries.get(field, {})
            rows.append([evaluate(self.system, row.get(g, ZERO), at) for g in fields])
        return torch.stack([torch.stack(row, dim=-1) for row in rows], dim=-2)


def variational_derivative(system: System, density: Expr) -> dict[str, Expr]:
    """Return ``δH/δx`` of ``H = ∫ h`` by field: ``Σ_V V* ∂h/∂(Vx)`` over the operators V in h.

    The boundary terms of the integration by parts vanish on periodic, fixed and insulated axes.

    Raises:
        InputError: the density applies an operator to a product.
    """
    separator = SemilinearBuilder(
        frozenset(system.fields), tuple(axis.name for axis in system.axes)
    )
    try:
        body = separator.pointwise(density)
    except NotSemilinearError as error:
        where = system.where("system.structure.H")
        raise InputError(f"H applies an operator to a product: {error}", where=where) from None
    inputs = separator.inputs
    known: dict[str, Expr] = {
        n: apply_operator(v.operator, Name(v.field)) for n, v in inputs.items()
    }
    found: dict[str, list[Expr]] = {field: [] for field in system.fields}
    for name, read in inputs.items():
        slope = substitute(differentiate(body, name), known)
        found[read.field].append(_adjoint(read.operator, slope))
    return {field: add(parts) for field, parts in found.items()}


def _adjoint(operator: Expr, operand: Expr) -> Expr:
    """Return ``V* f``: integration by parts changes the sign of every derivative."""
    match operator:
        case Derivative(inner, axis, order):
            return _adjoint(inner, scale((-1.0) ** order, derivative(operand, axis, order)))
        case Call(function, inner):
            return _adjoint(inner, call(function, operand))
    return operand


def _entries(
    system: System, texts: Mapping[str, Mapping[str, str]], part: str, columns: tuple[str, ...]
) -> Entries:
    found: Entries = {}
    for field, row in texts.items():
        for other, text in row.items():
            key = f"system.structure.{part}.{field}.{other}"
            for name, known in ((field, system.fields), (other, columns)):
                if name not in known:
                    what = f"{part} names {name}, which the system does not have"
                    raise InputError(what, where=system.where(key), hint=nearest(name, known))
            entry = system.resolve(system.parse(str(text), key), key)
            found.setdefault(field, {})[other] = entry
    return found


def close_fields(left: Tensor, right: Tensor) -> bool:
    """Return whether two fields are equal up to rounding."""
    size = float(torch.maximum(left.abs().max(), right.abs().max()))
    return float((left - right).abs().max()) <= RELATIVE_TOLERANCE * size


def _semidefinite(matrix: Tensor) -> bool:
    least = float(torch.linalg.eigvalsh(matrix).min())
    return least >= -RELATIVE_TOLERANCE * float(matrix.abs().max())
