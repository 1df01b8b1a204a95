"""Make a case of a problem that another paper published."""

from __future__ import annotations

import numpy as np

from dashred.evaluation.foreign.cases.case import (
    Case,
    MadeCase,
    Sensor,
    TrueTerm,
    Truth,
    start_section,
)
from dashred.evaluation.foreign.cases.dysts_cases import START_ERROR, integrate, simulator_equations
from dashred.evaluation.foreign.cases.field_cases import make_case_of_equation
from dashred.evaluation.foreign.cases.polynomials import evaluate, monomials, text_of
from dashred.evaluation.foreign.cases.published_problems import (
    KS_PROBLEMS,
    LORENZ,
    LORENZ_DEGREE,
    LORENZ_INTERVAL,
    LORENZ_PROBLEMS,
)

STEPS_PER_SAMPLE = 2


def make_published_case(case: Case) -> MadeCase:
    """Make the recording and the truth of a case.

    Raises:
        ArithmeticError: the truth cannot be computed.
        InputError: ``py-pde`` is not installed.
    """
    if case.system in KS_PROBLEMS:
        return make_case_of_equation(case, KS_PROBLEMS[case.system])
    return _make_lorenz_case(case)


def _make_lorenz_case(case: Case) -> MadeCase:
    problem, names = LORENZ_PROBLEMS[case.system], LORENZ.variables
    rng = case.stream("what")
    samples = round(problem.until / LORENZ_INTERVAL)
    times = np.linspace(0.0, (samples - 1) * LORENZ_INTERVAL, samples)
    states = integrate(LORENZ.tendency, np.array(LORENZ.start), times)
    every = [(i, monomial) for i, terms in enumerate(LORENZ.equations) for monomial in terms]
    left_out = every if problem.whole else [every[int(rng.integers(len(every)))]]
    hidden = np.zeros_like(states)
    terms = []
    for equation, monomial in left_out:
        coefficient = LORENZ.equations[equation][monomial]
        hidden[:, equation] += coefficient * evaluate(monomial, states)
        terms.append(TrueTerm(names[equation], text_of(monomial, names), coefficient))
    std = states.std(axis=0)
    stated = states[0] + START_ERROR * std * rng.standard_normal(len(names))
    library = [text_of(monomial, names) for monomial in monomials(len(names), LORENZ_DEGREE)]
    return MadeCase(
        system={
            "title": "Lorenz",
            "fields": {name: f"variable {name}" for name in names},
            "equations": simulator_equations(LORENZ, left_out),
            **start_section(names, stated, START_ERROR * std),
            "integrator": {"method": "rk4", "dt": LORENZ_INTERVAL / STEPS_PER_SAMPLE},
        },
        library={name: library for name in names},
        sensors=tuple(Sensor(name, name) for name in names),
        readings=states + case.noise * std * rng.standard_normal(states.shape),
        truth=Truth(
            kind=case.kind,
            says=", ".join(f"{t.equation}: {t.coefficient:+.4g}·{t.term}" for t in terms),
            times=times,
            states=states,
            hidden=hidden,
            terms=tuple(terms),
        ),
    )
