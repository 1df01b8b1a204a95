"""Make a case of a polynomial system: one term is left out of the simulator.

The trajectory is computed by SciPy's DOP853. It begins a random time after the initial state of the
collection, and has 320 samples over 10 periods.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass

import numpy as np

from dashred.evaluation.foreign.cases.case import (
    Array,
    Case,
    MadeCase,
    Sensor,
    TrueTerm,
    Truth,
    start_section,
)
from dashred.evaluation.foreign.cases.dysts_systems import PolynomialSystem, polynomial_systems
from dashred.evaluation.foreign.cases.polynomials import Monomial, evaluate, text_of

SAMPLES, PERIODS = 320, 10
# The record begins up to this many periods after the initial state of the collection.
LATEST_BEGIN = 5.0
# Smallest share of the rms of its equation that a term has to have, to be left out.
SMALLEST_SHARE = 0.05
# The stated start is off by this share of the std of each variable.
START_ERROR = 0.1
STEPS_PER_SAMPLE = 10
TOLERANCE = 1e-10


@dataclass(frozen=True)
class LeftOut:
    """The term that is left out.

    Attributes:
        equation: index of its equation.
        monomial: the term.
        coefficient: its coefficient.
        share: rms of the term over that of the tendency.
    """

    equation: int
    monomial: Monomial
    coefficient: float
    share: float


def make_dysts_case(case: Case) -> MadeCase:
    """Make the recording and the truth of a case.

    Raises:
        ArithmeticError: the trajectory cannot be computed.
        InputError: ``dysts`` is not installed.
    """
    system = polynomial_systems()[case.system]
    rng = case.stream("what")
    begin = rng.uniform(0, LATEST_BEGIN) * system.period
    times = np.linspace(0, PERIODS * system.period, SAMPLES)
    states = integrate(system.tendency, np.array(system.start), begin + times)
    std = states.std(axis=0)
    possible = terms_that_matter(system, states)
    left_out = possible[rng.integers(len(possible))]
    names = system.variables
    measured = _measured(system, left_out, rng)
    sensors = tuple(Sensor(name, name) for name in measured)
    columns = [names.index(name) for name in measured]
    noise = case.noise * std[columns] * rng.standard_normal((SAMPLES, len(columns)))
    stated = states[0] + START_ERROR * std * rng.standard_normal(len(names))
    hidden = np.zeros_like(states)
    hidden[:, left_out.equation] = left_out.coefficient * evaluate(left_out.monomial, states)
    term = TrueTerm(
        names[left_out.equation], text_of(left_out.monomial, names), left_out.coefficient
    )
    says = f"{term.equation}: {term.coefficient:+.4g}·{term.term} ({100 * left_out.share:.0f} %)"
    unmeasured = set(names) - set(measured)
    return MadeCase(
        system={
            "title": f"{system.name} of dysts",
            "fields": {name: f"variable {name}" for name in names},
            "equations": simulator_equations(system, [(left_out.equation, left_out.monomial)]),
            **start_section(names, stated, START_ERROR * std),
            "integrator": {
                "method": "rk4",
                "dt": float(f"{times[1] / STEPS_PER_SAMPLE:.6g}"),
            },
        },
        library=None,
        sensors=sensors,
        readings=states[:, columns] + noise,
        truth=Truth(
            kind=case.kind,
            says=says + "".join(f"; {name} is not measured" for name in sorted(unmeasured)),
            times=times,
            states=states,
            hidden=hidden,
            terms=(term,),
        ),
    )


def integrate(tendency: Callable[[Array], Array], start: Array, times: Array) -> Array:
    """Return the states ``(time, variable)`` at times after 0.

    Raises:
        ArithmeticError: the solver fails.
    """
    from scipy.integrate import solve_ivp

    solved = solve_ivp(
        lambda _, state: tendency(state[None])[0],
        (0.0, times[-1]),
        start,
        method="DOP853",
        rtol=TOLERANCE,
        atol=TOLERANCE * max(1e-3, float(np.abs(start).max())),
        t_eval=times,
    )
    if not solved.success or not np.isfinite(solved.y).all():
        raise ArithmeticError(f"the truth cannot be integrated: {solved.message}")
    return np.ascontiguousarray(solved.y.T)


def terms_that_matter(system: PolynomialSystem, states: Array) -> list[LeftOut]:
    """Return the terms whose rms is more than 5 % of that of the tendency of their equation."""
    tendencies = np.sqrt(np.mean(system.tendency(states) ** 2, axis=0))
    terms = [
        LeftOut(
            i,
            monomial,
            coefficient,
            float(
                np.sqrt(np.mean((coefficient * evaluate(monomial, states)) ** 2))
                / max(tendencies[i], 1e-300)
            ),
        )
        for i, equation in enumerate(system.equations)
        for monomial, coefficient in equation.items()
    ]
    return [term for term in terms if term.share > SMALLEST_SHARE]


def _measured(system: PolynomialSystem, left_out: LeftOut, rng: np.random.Generator) -> str:
    """Return the measured variables: all, or, in half of the cases, all but one.

    A variable that acts on no other variable is always measured: nothing else shows it.
    """
    names = system.variables
    acting = {
        i
        for equation, polynomial in enumerate(system.equations)
        for monomial in polynomial
        if (equation, monomial) != (left_out.equation, left_out.monomial)
        for i in monomial
        if i != equation
    }
    unmeasured = rng.random() < 0.5
    choice = int(rng.integers(max(1, len(acting))))
    if not unmeasured or not acting:
        return names
    return names.replace(names[sorted(acting)[choice]], "")


def simulator_equations(
    system: PolynomialSystem, left_out: Sequence[tuple[int, Monomial]]
) -> dict[str, str]:
    """Return the equations of the simulator.

    Args:
        system: of the truth.
        left_out: indices of equations and terms that the simulator lacks.
    """
    names = system.variables
    return {
        name: _sum(
            (coefficient, text_of(monomial, names))
            for monomial, coefficient in polynomial.items()
            if (i, monomial) not in left_out
        )
        for i, (name, polynomial) in enumerate(zip(names, system.equations, strict=True))
    }


def _sum(terms: Iterable[tuple[float, str]]) -> str:
    """Return a sum as text: ``28*x - y - x*z``; ``0`` without terms."""
    text = ""
    for coefficient, term in terms:
        sign = "-" if coefficient < 0 else "+"
        number = f"{abs(coefficient):.12g}"
        product = number if term == "1" else term if number == "1" else f"{number}*{term}"
        text += f" {sign} {product}" if text else product if sign == "+" else f"-{product}"
    return text or "0"
