"""A batch of states that a program is to step, and the states that it returns."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]
Rows = Sequence[int] | NDArray[np.int64]


class ProgramError(Exception):
    """A program failed, or returned something that is not a state.

    Attributes:
        hint: what to do.
    """

    def __init__(self, what: str, hint: str | None = None) -> None:
        super().__init__(what)
        self.hint = hint


@dataclass(frozen=True)
class StateBatch:
    """States to step, each with its own time.

    Attributes:
        states: ``(batch, field, *grid)``.
        t: times, ``(batch,)``.
        dt: lengths of the steps, ``(batch,)``.
        inputs: values in the middle of the step by name, ``(batch,)`` each.
        parameters: values by name.
    """

    states: Array
    t: Array
    dt: Array
    inputs: Mapping[str, Array]
    parameters: Mapping[str, float]

    def __len__(self) -> int:
        """Return the number of states."""
        return len(self.states)

    def take(self, rows: Rows) -> StateBatch:
        """Return a part of the batch."""
        rows = np.asarray(rows)
        inputs = {name: values[rows] for name, values in self.inputs.items()}
        return StateBatch(self.states[rows], self.t[rows], self.dt[rows], inputs, self.parameters)


def read_fields(found: Any, fields: Sequence[str], shape: tuple[int, ...]) -> Array:
    """Return the fields of a state that a program returned, ``(field, *shape)``.

    Args:
        found: arrays of NumPy, torch or JAX by field.
        fields: of the system, in their order.
        shape: of each field.

    Raises:
        ProgramError: a field is missing, or has another shape or no numbers.
    """
    if not isinstance(found, Mapping):
        hint = f"return {{{', '.join(f'{name!r}: …' for name in fields)}}}"
        raise ProgramError(f"returns {type(found).__name__}, not a dictionary of fields", hint)
    result = np.empty((len(fields), *shape))
    for i, name in enumerate(fields):
        if name not in found:
            told = ", ".join(map(str, found)) or "nothing"
            raise ProgramError(f"returns no field {name}, but {told}")
        values = as_array(found[name])
        if values.dtype.kind not in "fiub":
            raise ProgramError(f"returns {name} as {values.dtype}, not as real numbers")
        if values.shape != shape:
            raise ProgramError(f"returns {name} with the shape {values.shape} instead of {shape}")
        result[i] = values
    return result


def as_array(values: Any) -> NDArray[Any]:
    """Return an array of NumPy, torch or JAX as a NumPy array."""
    if hasattr(values, "detach"):  # A tensor of torch may carry gradients, or be on a GPU.
        values = values.detach().cpu()
    return np.asarray(values)
