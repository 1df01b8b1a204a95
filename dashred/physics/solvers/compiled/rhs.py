"""Compiled right-hand side of a batch of spectral states in which each row has its own terms."""

from __future__ import annotations

from collections.abc import Iterable, Sequence

import numpy as np
from numpy.typing import NDArray

from dashred.physics.backends.channels import Channels
from dashred.physics.backends.numba_backend import Array, ChannelTerm, compile_kernel, names_used
from dashred.physics.expressions.algebra import Expr
from dashred.physics.expressions.semilinear import SemilinearForm
from dashred.physics.forcing_basis import SampledForcing
from dashred.physics.grids.fourier_symbols import symbols
from dashred.physics.grids.spectral import Spectral
from dashred.physics.grids.transforms import to_modes
from dashred.physics.solvers.batch_coefficients import CoefficientLayout
from dashred.physics.solvers.compiled.tendency import Modes, TendencyArrays
from dashred.physics.solvers.rhs import dealias_mask
from dashred.physics.system import CPU, System, Term
from dashred.physics.window import Shape


class CompiledTendency:
    """``û' = Lû + N(û, t)`` in semilinear form, compiled once.

    The semilinear form is that of :mod:`dashred.physics.expressions.semilinear`.

    Args:
        system: a spectral system.
        terms: all terms that a trajectory may have, with lets and parameters resolved.
        shapes: the possible factors of the windows; only pointwise terms can have a window.

    Raises:
        NotSemilinearError, ArithmeticError: see :func:`.semilinear.semilinear_form`.
    """

    def __init__(
        self, system: System, terms: Sequence[Term], shapes: tuple[Shape, ...] = ()
    ) -> None:
        assert isinstance(system.operators, Spectral)
        self.layout = CoefficientLayout(len(terms), shapes)
        self.operators, self.grid = system.operators, system.grid
        self.fields = {field: i for i, field in enumerate(system.fields)}
        axes = [axis.name for axis in system.axes]
        columns = [self.layout.window_column(j) for j in range(len(terms))]
        channels = Channels(
            system.resolved,
            [(term.equation, term.expression) for term in terms],
            axes,
            [column for column in columns if column is not None] if shapes else None,
        )
        base, forms, self._channels = channels.base, channels.forms, channels.index
        self.channel_terms = channels.functions
        self._symbols = self._term_symbols(forms)
        self._base_symbols = symbols(list(base.linear.values()), self.operators, CPU).numpy()
        self._couplings = [*self._coupling_symbols(base, None)]
        for j, form in enumerate(forms):
            self._couplings += self._coupling_symbols(form, j)
        derived = channels.derived
        self._derived = [
            (name, self.fields[v.field], self._symbol(v.operator)) for name, v in derived.items()
        ]
        self._readers = [
            [f for f in self.channel_terms if name in names_used([f])] for name in derived
        ]
        self._writers = [
            [f for f in self.channel_terms if f.channel == c] for c in range(len(self._channels))
        ]
        coordinates = self.grid.places
        read = [*self.fields, *derived]
        self.kernel = compile_kernel(
            self.channel_terms, read, list(coordinates), self.layout.factors(), system.input_signals
        )
        shape = self.grid.shape
        points = [np.broadcast_to(x.numpy(), shape).ravel() for x in coordinates.values()]
        self._coordinates = np.array(points)
        self._channel_fields = _indices(self.fields[equation] for equation, _ in self._channels)
        channel_symbols = [self._symbol(operator) for _, operator in self._channels]
        self._channel_symbols = _rows(channel_symbols, self._base_symbols[0].size)
        self._mask = dealias_mask(system).numpy() if system.config.integrator.dealias else None

    def batch(self, weights: Array, sampled_forcing: SampledForcing | None = None) -> BatchTendency:
        """Return the right-hand side of a batch.

        Args:
            weights: coefficients of the terms, ``(row, column)``.
            sampled_forcing: free forcing of each row.
        """
        return BatchTendency(self, np.ascontiguousarray(weights), sampled_forcing)

    def _coupling_symbols(
        self, form: SemilinearForm, weight: int | None
    ) -> list[tuple[int, int, Modes, int | None]]:
        return [
            (self.fields[equation], self.fields[field], self._symbol(operator), weight)
            for equation, couplings in form.couplings.items()
            for field, operator in couplings.items()
        ]

    def _term_symbols(self, forms: Sequence[SemilinearForm]) -> Modes:
        """Return the contribution of each term to L, ``(term, field, *modes)``."""
        result = [
            symbols(list(form.linear.values()), self.operators, CPU).numpy() for form in forms
        ]
        *first, last = self.grid.shape
        shape = (len(self.fields), *first, last // 2 + 1)
        return np.array(result).reshape(-1, *shape)

    def _symbol(self, operator: Expr) -> Modes:
        result: Modes = symbols([[operator]], self.operators, CPU)[0].numpy()
        return result


class BatchTendency:
    """The right-hand side of one batch.

    Attributes:
        linear: L, ``(row, field, *modes)``; one row if L is the same for all trajectories.
        arrays: N.
        counts: number of inputs and of channels of the kernel.
    """

    def __init__(
        self, compiled: CompiledTendency, weights: Array, sampled_forcing: SampledForcing | None
    ) -> None:
        terms = weights[:, : compiled.layout.terms]
        added = np.tensordot(terms, compiled._symbols, axes=1)
        self.linear = compiled._base_symbols + (added if added.any() else np.zeros_like(added[:1]))
        self.counts = len(compiled.fields) + len(compiled._derived), len(compiled._channel_fields)
        couplings = compiled._couplings
        modes = self.linear[0, 0].size
        mask = np.ones(modes) if compiled._mask is None else compiled._mask.ravel()
        self.arrays = TendencyArrays(
            input_field=_indices(field for _, field, _ in compiled._derived),
            input_symbol=_rows([symbol for _, _, symbol in compiled._derived], modes),
            input_active=_active(compiled._readers, weights),
            channel_active=_active(compiled._writers, weights),
            channel_field=compiled._channel_fields,
            channel_symbol=compiled._channel_symbols,
            coupling_target=_indices(equation for equation, *_ in couplings),
            coupling_source=_indices(field for _, field, *_ in couplings),
            coupling_symbol=_rows([symbol for *_, symbol, _ in couplings], modes),
            coupling_strength=np.stack(
                [np.ones(len(weights)) if j is None else weights[:, j] for *_, j in couplings]
                or [np.zeros(0)] * len(weights),
                axis=int(bool(couplings)),
            ),
            mask=mask.astype(np.float64),
            coordinates=compiled._coordinates,
            weights=weights,
            knots=np.zeros(0) if sampled_forcing is None else sampled_forcing.knots.numpy(),
            sampled_forcing=_forcing_modes(sampled_forcing, modes),
        )

    def transforms(self, rows: slice) -> int:
        """Return the number of Fourier transforms of one field, for N of some rows once."""
        arrays = self.of_rows(rows)
        fields = self.linear.shape[1] * len(arrays.weights)
        return fields + int(arrays.input_active.sum()) + int(arrays.channel_active.sum())

    def of_rows(self, rows: slice) -> TendencyArrays:
        """Return N of some rows."""
        whole = self.arrays
        return whole._replace(
            input_active=whole.input_active[rows],
            channel_active=whole.channel_active[rows],
            coupling_strength=whole.coupling_strength[rows],
            weights=whole.weights[rows],
            sampled_forcing=whole.sampled_forcing[rows],
        )


def _forcing_modes(sampled_forcing: SampledForcing | None, modes: int) -> Modes:
    """Return the forcing in modes, ``(row, knot, field, mode)``."""
    if sampled_forcing is None:
        return np.zeros((0, 0, 0, modes), dtype=np.complex128)
    hats = to_modes(sampled_forcing.values.numpy(), sampled_forcing.values.dim() - 3)
    return np.ascontiguousarray(hats.reshape(*hats.shape[:3], modes))


def _active(groups: Sequence[Sequence[ChannelTerm]], weights: Array) -> NDArray[np.bool_]:
    """Return whether each row has a term of each group, ``(row, group)``."""
    active = np.zeros((len(weights), len(groups)), dtype=np.bool_)
    for index, group in enumerate(groups):
        for term in group:
            columns = [c for c in (term.weight, term.window_weight) if c is not None]
            active[:, index] |= (weights[:, columns] != 0).any(axis=1) if columns else True
    return active


def _indices(values: Iterable[int]) -> NDArray[np.int64]:
    return np.array(list(values), dtype=np.int64)


def _rows(symbols: Sequence[Modes], modes: int) -> Modes:
    return np.array(symbols, dtype=np.complex128).reshape(-1, modes)
