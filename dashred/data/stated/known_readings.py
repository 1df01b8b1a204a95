"""Sensors that read functions of the inputs or of time as well as of the state.

The known part is subtracted, and a known factor (:mod:`dashred.data.stated.known_factor`) divided
by.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from dashred.core.errors import InputError
from dashred.data.episodes import Episode, Episodes
from dashred.data.inputs import values_at_times, with_inputs
from dashred.data.recording import Recording
from dashred.data.sensors import Sensor
from dashred.data.stated.known_factor import SMALLEST, divided, factored, typical_factor
from dashred.physics.expressions.algebra import ZERO, Expr, add, names, summands, to_text
from dashred.physics.expressions.free_names import free_name
from dashred.physics.expressions.monomials import products
from dashred.physics.system import System


def subtract_known_readings(
    system: System, episodes: Episodes
) -> tuple[System, Episodes, list[str]]:
    """Subtract from readings what the inputs and the time contribute to them.

    A sensor that reads ``y = h(u) + g(e, t)``, with measured inputs e, becomes one that reads
    ``h(u)``: the values of ``g`` are known. The function h is added to the system as a let. If g
    depends on a parameter, it is subtracted at its stated value. Then, and if the noise depends on
    the reading, g is added to the system as a let: ``known`` of the sensor. A sensor that reads
    ``y = f(e, t) h(u) + g(e, t)`` has its readings divided by f, too, and its ``factor`` is f over
    its typical size.

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
        split = _split(system, sensor)
        size, known, clause = 1.0, to_text(split.known), ""
        if split.factor is not None:
            size = _size(system, sensor, split.factor, episodes)
            known = "0" if known == "0" else divided(known, split.factor, size)
            clause = f" divided by {to_text(split.factor)}"
        name = free_name(f"{sensor.reads}_of_state", system.names)
        let, label, factor = {**system.config.let, name: to_text(split.of_state)}, "", ""
        if names(split.known) & system.config.parameters.keys() or sensor.noise_law:
            label = free_name(f"{sensor.reads}_known", system.names)
            let[label] = known
        units = dict(system.units)
        if split.factor is not None:
            factor = free_name(f"{sensor.reads}_factor", system.names)
            let[factor] = f"({to_text(split.factor)})/{size!r}"
        elif sensor.reads in units:
            units[name] = units[sensor.reads]
        system = system.with_config(replace(system.config, let=let, units=units))
        changed[sensor.reads] = _Parts(name, label, factor, size, known)
        parted = "" if split.known == ZERO else f" without its known part {to_text(split.known)}"
        clauses.append(f"{sensor.reads}{parted}{clause}")
    if not changed:
        return system, episodes, []
    parts = tuple(
        Episode(part.name, _without(system, part.recording, changed)) for part in episodes.episodes
    )
    return system, replace(episodes, episodes=parts), clauses


class _Parts(NamedTuple):
    """The parts of a quantity.

    Attributes:
        of_state, label, factor: lets of h, of g and of f; empty where none is needed.
        size: typical size of f.
        known: what is subtracted from the readings over f.
    """

    of_state: str
    label: str
    factor: str
    size: float
    known: str


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
            found[:, column] = values_at_times(system, sensor.known, recording.times)
    return found


def check_uncertain_have_effect(system: System, sensors: Sequence[Sensor]) -> None:
    """Check that an equation or a sensor depends on every uncertain parameter.

    What a program depends on is not known.

    Raises:
        InputError: neither an equation nor what a sensor reads depends on a parameter with a
            spread.
    """
    if system.program is not None:
        return
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


class _Split(NamedTuple):
    """The functions h, g and f of a quantity; f is None for 1."""

    of_state: Expr
    known: Expr
    factor: Expr | None = None


def _split(system: System, sensor: Sensor) -> _Split:
    fields = set(system.fields)
    given = system.clock | set(system.config.parameters)
    terms = [*summands(_in_fields(system, sensor.reads))]
    known = [term for term in terms if names(term) & system.clock and names(term) <= given]
    of_state = add([term for term in terms if term not in known])
    if mixed := names(of_state) & system.clock:
        terms = [part for term in terms for part in products(term)]
        product = factored([term for term in terms if names(term) & fields], system.clock)
        rest = add([term for term in terms if not names(term) & fields])
        if product is not None and names(rest) <= given:
            return _Split(product.of_state, rest, product.factor)
        hint = f"write it as h*f + g, with h a function of the fields, f and g of {min(mixed)}"
        raise _refused(system, sensor, hint)
    if not names(of_state) & fields:
        what = f"sensor {sensor.name!r} reads {sensor.reads!r}, which does not depend on a field"
        where = system.where(f"system.let.{sensor.reads}")
        raise InputError(what, where=where, hint="leave it out with recording.ignore")
    return _Split(of_state, add(known))


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
        std = None if sensor.std is None else sensor.std / parts.size
        sensor = replace(sensor, reads=parts.of_state, known=parts.label, factor=parts.factor)
        sensors.append(replace(sensor, std=std))
        if parts.factor:
            factors = values_at_times(driven, parts.factor, recording.times)
            factors[np.abs(factors) <= SMALLEST] = np.nan
            values[:, column] /= factors * parts.size
        values[:, column] -= values_at_times(driven, parts.known, recording.times)
    return replace(recording, sensors=tuple(sensors), values=values)


def _size(system: System, sensor: Sensor, factor: Expr, episodes: Episodes) -> float:
    """Return the typical size of a factor.

    Raises:
        InputError: it is 0 everywhere, or the noise depends on the reading.
    """
    where = system.where(f"system.let.{sensor.reads}")
    if sensor.noise_law is not None:
        problem = f"the noise of {sensor.name!r} depends on its reading, a product with "
        problem += f"{to_text(factor)}: only a constant noise is supported"
        raise InputError(problem, where=where, hint="state its std as a number or a share")
    parts = [part.recording for part in episodes.episodes]
    driven = [with_inputs(system, part.inputs) for part in parts]
    values = [
        values_at_times(one, to_text(factor), part.times)
        for one, part in zip(driven, parts, strict=True)
    ]
    size = typical_factor(values)
    if size == 0:
        problem = f"{sensor.reads} is a product with {to_text(factor)}, which is 0 at all samples"
        raise InputError(problem, where=where, hint="leave it out with recording.ignore")
    return size
