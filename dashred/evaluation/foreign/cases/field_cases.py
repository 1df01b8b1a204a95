"""Make a case of a field, recorded by a few sensors."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from dashred.evaluation.foreign.cases.case import (
    Array,
    Case,
    LaterStates,
    MadeCase,
    Sensor,
    Truth,
)
from dashred.evaluation.foreign.cases.field_equations import FIELD_EQUATIONS, FieldEquation
from dashred.evaluation.foreign.cases.field_solver import FieldSolver, Texts
from dashred.evaluation.foreign.cases.fitted_sensors import fitted_sensors
from dashred.evaluation.foreign.cases.hidden_in_fields import (
    Hidden,
    all_terms,
    draw_region,
    draw_source,
    known_terms,
    leave_out,
    round_to,
)
from dashred.evaluation.foreign.cases.sensor_errors import draw_error

# The parameters of a case are within this factor of those of the table.
PARAMETER_FACTOR = 1.25
# The true start is off the stated one by this share of the std of each field.
START_ERROR = 0.1
# Wave numbers of the error of the start.
START_WAVES = 4
PILOT_SAMPLES = 21


def make_field_case(case: Case) -> MadeCase:
    """Make the recording and the truth of a case.

    Raises:
        ArithmeticError: the truth cannot be computed.
        InputError: ``py-pde`` is not installed.
    """
    equation = FIELD_EQUATIONS[case.system]
    return make_case_of_equation(case, _with_drawn_parameters(equation, case.stream("parameters")))


def make_case_of_equation(case: Case, equation: FieldEquation) -> MadeCase:
    """Make the recording and the truth of a case with a given equation.

    Raises:
        ArithmeticError: the truth cannot be computed.
        InputError: ``py-pde`` is not installed.
    """
    solver = FieldSolver(equation, equation.parameters)
    stated = solver.start(equation.start)
    start = stated + _start_error(solver, stated, case.stream("start"))
    hidden = _hidden(case, solver, start)
    times = np.linspace(0, equation.duration, equation.samples)
    states, later = _integrate(solver, all_terms(equation, hidden), start, times)
    missing = solver.tendency(hidden.texts)
    lacking = np.stack([missing(t, state) for t, state in zip(times, states, strict=True)])
    sensors = _place_sensors(equation, case.stream("sensors"))
    readings, erring, says = _read(case, solver, sensors, times, states)
    return MadeCase(
        system=_system(equation, hidden, stated),
        library=equation.library,
        sensors=tuple(sensors),
        readings=readings,
        truth=Truth(
            kind=case.kind,
            says=says or hidden.says,
            times=times,
            states=solver.on_points(states),
            hidden=solver.on_points(lacking),
            terms=hidden.terms,
            region=hidden.region,
            period=hidden.period,
            sensor=erring,
            later=later,
        ),
    )


def _integrate(
    solver: FieldSolver, texts: Texts, start: Array, times: Array
) -> tuple[Array, LaterStates | None]:
    """Return the states ``(time, field, *cells)``, and those a pair interval later."""
    interval = solver.equation.pair_interval
    if interval is None:
        return solver.integrate(texts, start, times), None
    both = np.column_stack([times, times + interval]).ravel()[:-1]
    states = solver.integrate(texts, start, both)
    return states[::2], LaterStates(interval, solver.on_points(states[1::2]))


def _with_drawn_parameters(equation: FieldEquation, rng: np.random.Generator) -> FieldEquation:
    drawn = {
        name: round_to(value * PARAMETER_FACTOR ** rng.uniform(-1, 1))
        for name, value in equation.parameters.items()
    }
    return replace(equation, parameters=drawn)


def _start_error(solver: FieldSolver, stated: Array, rng: np.random.Generator) -> Array:
    """Return a smooth random field for each field of the equation."""
    length = solver.equation.length
    error = np.zeros_like(stated)
    for values, nominal in zip(error, stated, strict=True):
        for wave in range(1, START_WAVES + 1):
            for place in solver.coordinates.values():
                phase = 2 * np.pi * (wave * place / length + rng.uniform())
                values += rng.standard_normal() * np.cos(phase) / wave
        values *= START_ERROR * nominal.std() / max(float(values.std()), 1e-300)
    return error


def _hidden(case: Case, solver: FieldSolver, start: Array) -> Hidden:
    rng = case.stream("what")
    equation = solver.equation
    if case.kind == "term":
        return leave_out(equation, rng)
    if case.kind in ("sensor", "nothing"):
        return Hidden()
    times = np.linspace(0, equation.duration, PILOT_SAMPLES)
    states = solver.integrate(equation.terms, start, times)
    tendency = solver.tendency(equation.terms)
    rates = [tendency(t, state)[0] for t, state in zip(times, states, strict=True)]
    size = float(np.sqrt(np.mean(np.square(rates))))
    if case.kind == "region":
        return draw_region(solver, size, states, rng)
    return draw_source(solver, size, case.number % 2 == 1, rng)


def _place_sensors(equation: FieldEquation, rng: np.random.Generator) -> list[Sensor]:
    """Return sensors at random places, one in each of as many equal parts of the first axis.

    The fields are read in turn.
    """
    fields, count = list(equation.terms), equation.sensors
    first = (np.arange(count) + rng.uniform(0.1, 0.9, count)) / count
    others = rng.uniform(0, 1, (count, len(equation.axes) - 1))
    shares = np.column_stack([first, others])
    return [
        Sensor(
            f"s{i:02d}",
            fields[i % len(fields)],
            tuple(float(f"{share * equation.length:.6g}") for share in shares[i]),
        )
        for i in range(count)
    ]


def _read(
    case: Case, solver: FieldSolver, sensors: Sequence[Sensor], times: Array, states: Array
) -> tuple[Array, str | None, str]:
    """Return the readings, the sensor that errs, and what it does."""
    fields = list(solver.equation.terms)
    std = states.swapaxes(0, 1).reshape(len(fields), -1).std(axis=1)
    places = [
        np.array(coordinate) for coordinate in zip(*[s.position for s in sensors], strict=True)
    ]
    exact = solver.at(states, *places)
    columns = [fields.index(sensor.field) for sensor in sensors]
    clean = exact[:, columns, range(len(sensors))]
    noise = case.noise * std[columns]
    readings = clean + noise * case.stream("noise").standard_normal(clean.shape)
    if case.kind != "sensor":
        return readings, None, ""
    rng = case.stream("sensor")
    fitted = fitted_sensors(sensors, times, case.analysis_seed)
    erring = fitted[int(rng.integers(len(fitted)))]
    says, error = draw_error(times, float(noise[erring]), rng)
    readings[:, erring] += error
    name = sensors[erring].name
    return readings, name, f"sensor {name} {says}"


def _system(equation: FieldEquation, hidden: Hidden, stated: Array) -> dict[str, object]:
    """Return the section ``system`` of the configuration."""
    known = known_terms(equation, hidden)
    spread = START_ERROR * stated.reshape(len(stated), -1).std(axis=1)
    axis = {"length": float(f"{equation.length:.12g}"), "points": equation.points}
    return {
        "title": equation.title,
        "axes": {name: dict(axis) for name in equation.axes},
        "fields": {name: f"field {name}" for name in equation.terms},
        "parameters": dict(equation.parameters),
        **({"let": dict(equation.let)} if equation.let else {}),
        "equations": {name: " + ".join(texts) or "0" for name, texts in known.items()},
        "start": dict(equation.start),
        "spread": {
            name: float(f"{size:.4g}") for name, size in zip(equation.terms, spread, strict=True)
        },
        "integrator": {"dt": equation.step},
    }
