"""The other methods, what each is given, and which of them are asked about a case."""

from __future__ import annotations

from dataclasses import dataclass
from importlib.metadata import PackageNotFoundError, version
from typing import Literal

from dashred.evaluation.foreign.cases.case import Kind, Truth

Given = Literal["form", "full state", "pairs", "window", "past"]
GIVEN: dict[Given, str] = {
    "window": "the sensors, all samples at once",
    "past": "the sensors, sample by sample",
    "full state": "the full state with noise",
    "pairs": "pairs of full states, a short time apart",
    "form": "the sensors and the true terms, without their coefficients",
}


@dataclass(frozen=True)
class Method:
    """Another method.

    Attributes:
        title: of its column.
        given: what it is given beside the simulator and the library.
        packages: distributions that it runs on.
    """

    title: str
    given: Given
    packages: tuple[str, ...]


PEERS: dict[str, Method] = {
    "joint_sensors": Method(
        "state and law by Levenberg–Marquardt, removal by BIC", "window", ("numpy", "scipy")
    ),
    "ensemble_smoother": Method(
        "ensemble smoother, ES-MDA", "window", ("iterative-ensemble-smoother",)
    ),
    "iterative_smoother": Method("iterative ensemble smoother, IEnKS", "past", ("dapper",)),
    "filter": Method("ensemble filter with coefficients", "past", ("torch",)),
    "joint_full": Method(
        "state and law by Levenberg–Marquardt, removal by BIC", "full state", ("numpy", "scipy")
    ),
    "evidence_full": Method(
        "state and law together, removal by the evidence, ODR-BINDy",
        "full state",
        ("numpy", "scipy"),
    ),
    "weak_sindy": Method("PySINDy, weak form", "full state", ("pysindy",)),
    "ensemble_sindy": Method("PySINDy, ensemble", "full state", ("pysindy",)),
    "weak_pde": Method("PDE-FIND, weak form", "full state", ("pysindy",)),
    "pde_find": Method("PDE-FIND", "full state", ("pysindy",)),
    "medida": Method("MEDIDA, noise in both states", "pairs", ("scikit-learn",)),
    "medida_as_published": Method(
        "MEDIDA, noise in the first state alone, as in its code", "pairs", ("scikit-learn",)
    ),
    "oracle": Method("oracle: least squares by SciPy", "form", ("scipy",)),
}
# By the number of axes.
ASKED: dict[int, tuple[str, ...]] = {
    0: (
        *("joint_sensors", "ensemble_smoother", "iterative_smoother", "filter"),
        *("joint_full", "evidence_full", "weak_sindy", "ensemble_sindy", "oracle"),
    ),
    1: ("weak_pde", "pde_find", "filter"),
    2: ("pde_find", "filter"),
}
# Where there are pairs of states.
ASKED_ABOUT_PAIRS = ("medida", "medida_as_published")
# They can only name a law, or none.
KINDS: tuple[Kind, ...] = ("term", "nothing")


def asked_about(axes: int, truth: Truth) -> tuple[str, ...]:
    """Return the methods that are asked about a case.

    One that is told the true terms has no question to answer where there are none, and one that
    needs pairs of states is asked where the truth has them.
    """
    asked = tuple(name for name in ASKED[axes] if PEERS[name].given != "form" or truth.terms)
    return asked if truth.later is None else asked + ASKED_ABOUT_PAIRS


def versions_of(name: str) -> dict[str, str]:
    """Return the versions of the packages of a method."""
    return {package: _version(package) for package in PEERS[name].packages}


def _version(package: str) -> str:
    try:
        return version(package)
    except PackageNotFoundError:
        return "not installed"
