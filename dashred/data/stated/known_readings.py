"""Sensors that read functions of the inputs or of time as well as of the state."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from typing import NamedTuple

import numpy as np
import torch
from numpy.typing import NDArray

from dashred.core.errors import InputError
from dashred.data.episodes import Episode, Episodes
from dashred.data.inputs import at_times, with_inputs
from dashred.data.recording import Recording
from dashred.data.sensors import Sensor
from dashred.physics.expressions.algebra import Expr, add, names, summands, to_text
from dashred.physics.expressions.free_names import free_name
from dashred.physics.system import System


def subtract_known_readings(
    system: System, episodes: Episodes
) -> tuple[System, Episodes, list[str]]:
    """Subtract from readings what the inputs and the time contribute to them.

    A sensor that reads ``y = h(u) + g(e, t)``, with measured inputs e, becomes one that reads
    ``h(u)``: the values of ``g`` are known. The function h is added to the system as a let. If g
    depends on a parameter, it is subtracted at its stated value. Then, and if the noise depends on
    the reading, g is added to the system as a let: ``known`` of the sensor.

    Args:
        system: the simulator.
        episodes: the recording.

    Returns:
        The system and the recording of sensors that read functions of the state, and for each
        changed quantity a clause with what was subtracted.

    Raises:
        InputError: y depends on an input or on time in another way, or not on the state.
    """
    changed: dict[str, _Parts] = {}
    clauses = []
    for sensor in episodes.sensors:
        if sensor.reads in changed or not _reads_clock(system, sensor.reads):
            continue
        of_state, known = _split(system, sensor)
        name = free_name(f"{sensor.reads}_of_state", system.names)
        let, label = {**system.config.let, name: to_text(of_state)}, ""
        if names(known) & system.config.parameters.keys() or sensor.noise_law:
            label = free_name(f"{sensor.reads}_known", system.names)
            let[label] = to_text(known)
        units = dict(system.units)
        if sensor.reads in units:
            units[name] = units[sensor.reads]
        system = system.with_config(replace(system.config, let=let, units=units))
        changed[sensor.reads] = _Parts(name, label, known)
        clauses.append(f"{sensor.reads} without its known part {to_text(known)}")
    if not changed:
        return system, episodes, []
    parts = tuple(
        Episode(part.name, _without(system, part.recording, changed)) for part in episodes.episodes
    )
    return system, replace(episodes, episodes=parts), clauses


class _Parts(NamedTuple):
    """The parts of a quantity: the let of h, the let of g if it is needed, and g."""

    of_state: str
    label: str
    known: Expr


def with_known_at(recording: Recording, before: System, after: System) -> Recording:
    """Return a recording from which the known parts are subtracted at other parameter values.

    Args:
        recording: without the known parts of its readings.
        before: the system with the values at which they were subtracted, driven by its inputs.
        after: the system with the other values.
    """
    old, new = known_readings(recording, before), known_readings(recording, after)
    return replace(recording, values=recording.values + (old - new))


def known_readings(recording: Recording, system: System) -> NDArray[np.float64]:
    """Return the known parts that are lets, ``(time, sensor)``; 0 for other sensors.

    Args:
        recording: without these parts.
        system: with these lets, driven by its inputs.
    """
    found = np.zeros_like(recording.values)
    for column, sensor in enumerate(recording.sensors):
        if sensor.known:
            found[:, column] = _at_samples(system, sensor.known, recording)
    return found


def check_uncertain_have_effect(system: System, sensors: Sequence[Sensor]) -> None:
    """Check that an equation or a sensor depends on every uncertain parameter.

    Raises:
        InputError: neither an equation nor what a sensor reads depends on a parameter with a
            spread.
    """
    read = [system.parse(sensor.reads, f"system.let.{sensor.reads}") for sensor in sensors]
    whole = map(system.without_lets, [*system.equations.values(), *read])
    found = set().union(*map(names, whole))
    for name in system.config.parameter_spread:
        if name not in found:
            what = f"{name} has a spread, but neither an equation nor a sensor depends on it"
            place = system.where(f"system.parameter_spread.{name}")
            raise InputError(what, where=place, hint="remove the spread, or use the parameter")


def check_reads_state(system: System, sensors: Sequence[Sensor]) -> None:
    """Check that every sensor reads a function of the state alone.

    Raises:
        InputError: a sensor reads a ``let`` that depends on time or on an input.
    """
    for sensor in sensors:
        if _reads_clock(system, sensor.reads):
            raise _refused(system, sensor, "a sensor of a twin can read functions of fields only")


def _reads_clock(system: System, reads: str) -> bool:
    return bool(names(_in_fields(system, reads)) & system.clock)


def _in_fields(system: System, reads: str) -> Expr:
    """Return a quantity in fields, parameters, coordinates, inputs and time."""
    return system.without_lets(system.parse(reads, f"system.let.{reads}"))


def _split(system: System, sensor: Sensor) -> tuple[Expr, Expr]:
    """Return h and g of a quantity."""
    given = system.clock | set(system.config.parameters)
    terms = summands(_in_fields(system, sensor.reads))
    known = [term for term in terms if names(term) & system.clock and names(term) <= given]
    of_state = add([term for term in terms if term not in known])
    if mixed := names(of_state) & system.clock:
        hint = f"write it as a sum of a function of the fields and one of {min(mixed)}"
        raise _refused(system, sensor, hint)
    if not names(of_state) & set(system.fields):
        what = f"sensor {sensor.name!r} reads {sensor.reads!r}, which does not depend on a field"
        where = system.where(f"system.let.{sensor.reads}")
        raise InputError(what, where=where, hint="leave it out with recording.ignore")
    return of_state, add(known)


def _refused(system: System, sensor: Sensor, hint: str) -> InputError:
    on = min(names(_in_fields(system, sensor.reads)) & system.clock)
    what = f"sensor {sensor.name!r} reads {sensor.reads!r}, which depends on {on!r}"
    return InputError(what, where=system.where(f"system.let.{sensor.reads}"), hint=hint)


def _without(system: System, recording: Recording, changed: dict[str, _Parts]) -> Recording:
    """Return a recording without the known part of its readings."""
    driven = with_inputs(system, recording.inputs)
    values, sensors = recording.values.copy(), []
    for column, sensor in enumerate(recording.sensors):
        parts = changed.get(sensor.reads)
        if parts is None:
            sensors.append(sensor)
            continue
        sensors.append(replace(sensor, reads=parts.of_state, known=parts.label))
        values[:, column] -= _at_samples(driven, to_text(parts.known), recording)
    return replace(recording, sensors=tuple(sensors), values=values)


def _at_samples(system: System, text: str, recording: Recording) -> NDArray[np.float64]:
    """Return a function of inputs and time at the samples of a recording, ``(time,)``."""
    clock = system.coordinates_and_inputs(recording.times, torch.device("cpu"))
    expr = system.resolve(system.parse(text, text), text)
    return at_times(expr, clock, len(recording.times))
