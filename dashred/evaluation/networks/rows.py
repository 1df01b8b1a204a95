"""The rows of the table of networks."""

from __future__ import annotations

from typing import TypedDict

SIMULATION, SHRED, DYNAMICS = "simulation", "shred", "dynamics"


class LawScore(TypedDict):
    """A proposed law against the true one, in numbers of terms.

    Attributes:
        found: true terms that it has.
        spurious: other terms that it has.
        missed: true terms that it lacks.
        error: largest relative error of a coefficient of a true term; null without one.
    """

    found: int
    spurious: int
    missed: int
    error: float | None


class Row(TypedDict):
    """The result of a case.

    Attributes:
        system: name of the bundled system.
        twin: name of the hidden truth.
        seed: of the recording and of the networks.
        noise: of the sensors, in std.
        problem: why there is no result; null with one.
        rmse: RMSE of the whole field over the fit window in std of each true field, by method.
        laws: proposed laws: alg1 and alg2 by sensors alone, the others by variant with dynamics.
        seconds: run time by variant, with that of the training.
    """

    system: str
    twin: str
    seed: int
    noise: float
    problem: str | None
    rmse: dict[str, float]
    laws: dict[str, LawScore]
    seconds: dict[str, float]


def is_exact(law: LawScore) -> bool:
    """Return whether a law has exactly the true terms."""
    return law["spurious"] == law["missed"] == 0


def hides_a_law(row: Row) -> bool:
    """Return whether something is missing in the simulator of a row with a result."""
    law = row["laws"][DYNAMICS]
    return law["found"] + law["missed"] > 0


def ratio(row: Row, method: str, reference: str) -> float:
    """Return the error of a method over that of another one."""
    return row["rmse"][method] / row["rmse"][reference]
