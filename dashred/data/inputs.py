"""What drives the inputs of a twin: sampled as a recording would have it, past its end too."""

from __future__ import annotations

import numpy as np
import torch
from torch import Tensor

from dashred.config import Config
from dashred.core.errors import InputError
from dashred.physics.backends.input_signals import NOTHING, Measured
from dashred.physics.backends.torch_backend import Program
from dashred.physics.expressions.algebra import names
from dashred.physics.grids.grid_value import Value
from dashred.physics.grids.operators import NoSpace
from dashred.physics.system import System


def driven(system: System, config: Config, times: Tensor) -> Measured:
    """Return the inputs by column; between the samples they are straight lines, for all.

    Args:
        system: whose inputs these are.
        config: with ``recording.drive``.
        times: of the samples, ``(time,)``.

    Raises:
        InputError: an input has no drive, or one that reads more than t.
    """
    if not system.inputs:
        return NOTHING
    columns = {}
    for column in system.inputs.values():
        key = f"recording.drive.{column}"
        if column not in config.recording.drive:
            raise InputError(
                f"nothing drives the input {column!r} of this twin",
                where=config.where("recording.drive"),
                hint=f"give recording.drive.{column}, an expression of t",
            )
        expr = system.resolve(system.parse(config.recording.drive[column], key), key)
        if read := sorted(names(expr) - {"t"}):
            raise InputError(f"a drive reads t alone, not {read[0]}", where=config.where(key))
        [value] = Program([expr])({"t": Value(times)}, NoSpace())
        found = torch.as_tensor(NoSpace().on_grid(value), dtype=torch.float64)
        columns[column] = np.ascontiguousarray(found.expand(len(times)).numpy())
    return Measured(times.numpy(), columns)


def under(system: System, inputs: Measured) -> System:
    """Return the system under the inputs of a recording, ``inputs`` by column."""
    values = {name: inputs.values[column] for name, column in system.inputs.items()}
    return System(system.config, system.where, Measured(inputs.times, values))
