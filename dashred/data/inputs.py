"""Input signals of a twin experiment, sampled like the measured inputs of a recording."""

from __future__ import annotations

from collections.abc import Callable, Mapping

import numpy as np
import torch
from numpy.typing import NDArray
from torch import Tensor

from dashred.config import Config
from dashred.core.errors import InputError
from dashred.data.input_action import act, jump_times
from dashred.physics.backends.input_signals import NO_INPUTS, InputSignals
from dashred.physics.backends.torch_backend import Program
from dashred.physics.expressions.algebra import Expr, names
from dashred.physics.grids.grid_value import Value
from dashred.physics.grids.operators import NoSpace
from dashred.physics.system import System


def drive_signals(system: System, config: Config, times: Tensor) -> InputSignals:
    """Sample the expressions of ``recording.drive``.

    Between samples the signals act alike for the recorder and the analysis.

    Args:
        system: the system with these inputs.
        config: has ``recording.drive``.
        times: of the samples, ``(time,)``.

    Returns:
        Signals by column of the recording.

    Raises:
        InputError: an input has no drive, or its drive depends on a name other than t.
    """
    if not system.inputs:
        return NO_INPUTS
    columns = {}
    for column in system.inputs.values():
        key = f"recording.drive.{column}"
        if column not in config.recording.drive:
            raise InputError(
                f"the input {column!r} of this twin has no drive",
                where=config.where("recording.drive"),
                hint=f"set recording.drive.{column} to an expression in t",
            )
        expr = system.resolve(system.parse(config.recording.drive[column], key), key)
        if read := sorted(names(expr) - {"t"}):
            problem = f"a drive may depend on t only, not on {read[0]}"
            raise InputError(problem, where=config.where(key))
        columns[column] = at_times(expr, {"t": Value(times)}, len(times))
    return InputSignals(times.numpy(), columns)


def at_times(expr: Expr, values: Mapping[str, Value], count: int) -> NDArray[np.float64]:
    """Return a function of inputs and time at some times, ``(time,)``.

    Args:
        expr: the function, resolved.
        values: the time and the inputs, ``(time,)`` each.
        count: number of times.
    """
    [value] = Program([expr])(values, NoSpace())
    found = torch.as_tensor(NoSpace().on_grid(value), dtype=torch.float64)
    return np.ascontiguousarray(found.expand(count).numpy())


def values_at_times(system: System, text: str, times: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return a function of inputs and time at some times, ``(time,)``.

    Args:
        system: driven by its inputs.
        text: the function.
        times: in the unit of time of the system, ``(time,)``.
    """
    clock = system.coordinates_and_inputs(times, torch.device("cpu"))
    expr = system.resolve(system.parse(text, text), text)
    return at_times(expr, clock, len(times))


def check_delay(name: str, delay: float, inputs: InputSignals, where: Callable[[str], str]) -> None:
    """Check that an input acts within the recording.

    Raises:
        InputError: its delay is longer than the recording.
    """
    span = float(inputs.times[-1] - inputs.times[0])
    if delay and delay >= span:
        raise InputError(
            f"the delay of the input {name} is {delay:g}, but its samples span only {span:g}",
            where=where(f"system.inputs.{name}.delay"),
            hint="give a shorter delay; it is in the unit of time of the system",
        )


def with_inputs(system: System, inputs: InputSignals) -> System:
    """Return the system driven by measured inputs, given by column of the recording.

    Raises:
        InputError: the delay of an input is longer than the recording.
    """
    for name, own in system.config.inputs.items():
        check_delay(name, own.delay, inputs, system.where)
    return system.with_input_signals(acting_signals(system, inputs))


def acting_signals(system: System, inputs: InputSignals) -> InputSignals:
    """Return the signals by which measured inputs act: held between samples, and delayed.

    Args:
        system: declares the inputs.
        inputs: samples by column of the recording.
    """
    declared = system.config.inputs
    curves = {
        name: act(inputs.times, inputs.values[column], declared[name].hold, declared[name].delay)
        for name, column in system.inputs.items()
    }
    times = inputs.times
    if any(curve_times is not times for curve_times, _ in curves.values()):
        times = np.unique(np.concatenate([own for own, _ in curves.values()]))
    values = {name: np.interp(times, *curve) for name, curve in curves.items()}
    held = [
        jump_times(inputs.times, inputs.values[column], declared[name].delay)
        for name, column in system.inputs.items()
        if declared[name].hold
    ]
    jumps = np.unique(np.concatenate([np.zeros(0), *held]))
    return InputSignals(times, values, jumps)
