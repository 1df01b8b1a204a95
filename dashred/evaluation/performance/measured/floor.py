"""The floor: what a step of the march and of a column needs, counted from the scheme.

ETDRK4 evaluates ``N = Σ D[G(v)]`` at four stages. Each evaluation transforms the inputs v to the
grid and the channels G back to modes. A real transform of N points takes ``5/2 N log₂ N``
operations. Besides, every array is read or written once where the formulas have it, and every
product and sum of the formulas is counted. The derivative of the step has the same form in float32,
with ``δG = Σ ∂G/∂v δv``; what all columns share, as the slopes and the coefficients of the step, is
in the cache and not counted.

The floor in seconds is the time of the transforms at the measured rate, plus the time of the bytes
at the measured bandwidth, or that of the other operations if it is longer.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

from dashred.evaluation.performance.measured.rates import Rates
from dashred.physics.expressions.algebra import ZERO, Expr, names
from dashred.physics.expressions.nodes import children
from dashred.physics.expressions.semilinear import OPERAND, SemilinearForm

STAGES = 4
# The formulas of a step, for each mode: arrays of modes that are read or written, with and without
# the coefficients of the step, and operations.
#   a = half u + q n_u    b = half u + q n_a    c = half a + q (2 n_b - n_u)
#   u' = full u + first n_u + middle (n_a + n_b) + last n_c
STEP_ARRAYS, STEP_ARRAYS_SHARED, STEP_OPERATIONS = 26, 16, 72
# Operations of a complex product, and of one that is added to a sum.
PRODUCT, PRODUCT_AND_SUM = 6, 8


@dataclass(frozen=True)
class Needs:
    """What a piece of work needs.

    Attributes:
        transforms64: real Fourier transforms of one field in float64.
        transforms32: the same in float32.
        bytes: read and written outside of the transforms.
        operations: floating-point operations outside of the transforms.
    """

    transforms64: float = 0.0
    transforms32: float = 0.0
    bytes: float = 0.0
    operations: float = 0.0

    def __add__(self, other: Needs) -> Needs:
        """Return the needs of both."""
        return Needs(
            self.transforms64 + other.transforms64,
            self.transforms32 + other.transforms32,
            self.bytes + other.bytes,
            self.operations + other.operations,
        )

    def times(self, count: float) -> Needs:
        """Return the needs of so many pieces."""
        return Needs(
            count * self.transforms64,
            count * self.transforms32,
            count * self.bytes,
            count * self.operations,
        )

    def all_operations(self, points: int) -> float:
        """Return the floating-point operations, with those of transforms of so many points."""
        transforms = self.transforms64 + self.transforms32
        return self.operations + transforms * 2.5 * points * math.log2(points)

    def seconds(self, rates: Rates) -> float:
        """Return the floor in seconds."""
        transforms = self.transforms64 * rates.transform64 + self.transforms32 * rates.transform32
        return transforms + max(self.bytes / rates.bandwidth, self.operations / rates.arithmetic)


@dataclass(frozen=True)
class Scheme:
    """What the formulas of N have, for a system with a law.

    Attributes:
        points: grid points.
        modes: modes of one field.
        fields: number of fields.
        inputs, derived: inputs of G, and those that are not a field itself.
        channels, operators: channels, and those with an operator D.
        couplings: linear couplings of fields.
        pointwise: operations of all G at one point.
        slope_inputs, slope_derived, slope_channels, slope_operators: the same of N', where inputs
            and channels without a slope are left out.
        slopes: number of slopes.
        rows: sources that are transformed to modes, of all columns together.
    """

    points: int
    modes: int
    fields: int
    inputs: int
    derived: int
    channels: int
    operators: int
    couplings: int
    pointwise: int
    slope_inputs: int
    slope_derived: int
    slope_channels: int
    slope_operators: int
    slopes: int
    rows: int

    @classmethod
    def of(cls, form: SemilinearForm, shape: tuple[int, ...], rows: int) -> Scheme:
        """Count the scheme of a semilinear form on a grid.

        Args:
            form: of the equations with the law.
            shape: of the grid.
            rows: sources that are transformed to modes.
        """
        channels = [channel for channel in form.channels if channel.body != ZERO]
        read = frozenset[str]().union(*(names(channel.body) for channel in channels))
        inputs = [name for name in form.inputs if name in read]
        slopes = [form.slopes(channel) for channel in channels]
        sloping = [channel for channel, found in zip(channels, slopes, strict=True) if found]
        moved = frozenset[str]().union(*slopes)
        return cls(
            points=math.prod(shape),
            modes=math.prod(shape[:-1]) * (shape[-1] // 2 + 1),
            fields=len(form.linear),
            inputs=len(inputs),
            derived=sum(form.inputs[name].operator != OPERAND for name in inputs),
            channels=len(channels),
            operators=sum(channel.operator != OPERAND for channel in channels),
            couplings=sum(map(len, form.couplings.values())),
            pointwise=sum(operations(channel.body) for channel in channels),
            slope_inputs=len(moved),
            slope_derived=sum(form.inputs[name].operator != OPERAND for name in moved),
            slope_channels=len(sloping),
            slope_operators=sum(channel.operator != OPERAND for channel in sloping),
            slopes=sum(map(len, slopes)),
            rows=rows,
        )

    def march_step(self) -> Needs:
        """Return what one step of one trajectory needs, in float64."""
        arrays = 3 * self.derived + 2 * self.operators + self.channels + self.fields
        arrays += 2 * self.couplings
        complex_arrays = STAGES * arrays + STEP_ARRAYS * self.fields
        real_arrays = STAGES * (self.inputs + self.channels)
        by_mode = PRODUCT * self.derived + PRODUCT_AND_SUM * (self.operators + self.couplings)
        return Needs(
            transforms64=STAGES * (self.inputs + self.channels),
            bytes=16 * self.modes * complex_arrays + 8 * self.points * real_arrays,
            operations=self.modes * (STAGES * by_mode + STEP_OPERATIONS * self.fields)
            + STAGES * self.points * self.pointwise,
        )

    def column_step(self) -> Needs:
        """Return what one step of one column needs, in float32."""
        arrays = 2 * self.slope_derived + self.slope_channels + self.fields + self.couplings
        complex_arrays = STAGES * arrays + STEP_ARRAYS_SHARED * self.fields
        transformed = self.slope_inputs + self.slope_channels
        by_mode = PRODUCT * self.slope_derived
        by_mode += PRODUCT_AND_SUM * (self.slope_operators + self.couplings)
        return Needs(
            transforms32=STAGES * transformed,
            bytes=8 * self.modes * complex_arrays + 4 * self.points * STAGES * transformed,
            operations=self.modes * (STAGES * by_mode + STEP_OPERATIONS * self.fields)
            + 2 * STAGES * self.points * self.slopes,
        )

    def jacobian(self, columns: int, steps: int, outputs: int) -> Needs:
        """Return what a Jacobian needs.

        Args:
            columns: number of columns.
            steps: number of time steps.
            outputs: number of times at which the columns are needed on the grid.
        """
        read = Needs(transforms32=self.fields * outputs)
        column = self.column_step().times(steps) + read
        sources = Needs(transforms32=STAGES * self.rows)
        return column.times(columns) + (self.march_step() + sources).times(steps)


def operations(expr: Expr) -> int:
    """Return the operations of an expression at one point."""
    below = children(expr)
    return sum(map(operations, below)) + (max(1, len(below) - 1) if below else 0)
