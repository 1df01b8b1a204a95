"""Make a case of a mechanism."""

from __future__ import annotations

import numpy as np

from dashred.evaluation.foreign.cases.case import (
    Array,
    Case,
    MadeCase,
    Sensor,
    Truth,
    start_section,
)
from dashred.evaluation.foreign.cases.mechanisms import MECHANISMS, Mechanism, Values
from dashred.evaluation.foreign.cases.phases import Phase, integrate_phases
from dashred.evaluation.foreign.cases.sensor_errors import draw_error

SAMPLES = 401
STEPS_PER_SAMPLE = 4
# Values of a case are within this factor of those of the table.
FACTOR = 1.2
# The stated start is off by this share of the std of each field.
START_ERROR = 0.1


def make_mechanics_case(case: Case) -> MadeCase:
    """Make the recording and the truth of a case.

    Raises:
        ArithmeticError: the truth cannot be computed.
    """
    mechanism = MECHANISMS[case.system]
    rng = case.stream("what")
    known, secret = (_draw(values, rng) for values in (mechanism.parameters, mechanism.secret))
    values = known | secret
    is_hidden = case.kind == "term"
    phases = mechanism.phases(values) if is_hidden else {mechanism.begin: Phase(_nothing)}
    start = np.array(mechanism.start) * FACTOR ** rng.uniform(-1, 1)
    times = np.linspace(0, mechanism.duration, SAMPLES)
    whole, lacking = integrate_phases(mechanism.known(known), phases, mechanism.begin, start, times)
    count = len(mechanism.fields)
    states, hidden = whole[:, :count], lacking[:, :count]
    measured = _measured(mechanism, case, rng)
    readings, erring, says = _read(case, mechanism, measured, times, states)
    return MadeCase(
        system=_system(mechanism, known, times, states, rng),
        library=None,
        sensors=tuple(Sensor(name, name) for name in measured),
        readings=readings,
        truth=Truth(
            kind=case.kind,
            says=says or (f"{mechanism.says} ({_values(secret)})" if is_hidden else "nothing"),
            times=times,
            states=states,
            hidden=hidden,
            terms=mechanism.terms(values) if is_hidden else (),
            sensor=erring,
        ),
    )


def _nothing(_: float, state: Array) -> Array:
    return np.zeros_like(state)


def _draw(values: Values, rng: np.random.Generator) -> dict[str, float]:
    return {
        name: float(f"{value * FACTOR ** rng.uniform(-1, 1):.3g}") for name, value in values.items()
    }


def _values(values: Values) -> str:
    return ", ".join(f"{name} = {value:g}" for name, value in values.items())


def _measured(mechanism: Mechanism, case: Case, rng: np.random.Generator) -> tuple[str, ...]:
    """Return the measured fields: the positions, and in half of the cases the velocities too.

    Where a sensor errs, both are measured.
    """
    both = rng.random() < 0.5 or case.kind == "sensor"
    return tuple(mechanism.fields) if both else mechanism.positions


def _read(
    case: Case, mechanism: Mechanism, measured: tuple[str, ...], times: Array, states: Array
) -> tuple[Array, str | None, str]:
    """Return the readings, the sensor that errs, and what it does."""
    columns = [list(mechanism.fields).index(name) for name in measured]
    clean = states[:, columns]
    noise = case.noise * clean.std(axis=0)
    readings = clean + noise * case.stream("noise").standard_normal(clean.shape)
    if case.kind != "sensor":
        return readings, None, ""
    rng = case.stream("sensor")
    erring = int(rng.integers(len(measured)))
    says, error = draw_error(times, float(noise[erring]), rng)
    readings[:, erring] += error
    return readings, measured[erring], f"sensor {measured[erring]} {says}"


def _system(
    mechanism: Mechanism,
    known: Values,
    times: Array,
    states: Array,
    rng: np.random.Generator,
) -> dict[str, object]:
    """Return the section ``system`` of the configuration."""
    spread = START_ERROR * states.std(axis=0)
    stated = states[0] + spread * rng.standard_normal(len(spread))
    return {
        "title": mechanism.title,
        "fields": dict(mechanism.fields),
        "parameters": dict(known),
        "equations": dict(mechanism.equations),
        **start_section(mechanism.fields, stated, spread),
        "integrator": {"method": "rk4", "dt": float(f"{times[1] / STEPS_PER_SAMPLE:.6g}")},
    }
