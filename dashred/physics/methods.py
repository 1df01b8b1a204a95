"""The integrators by name: each advances a batch of states."""

from __future__ import annotations

from collections.abc import Mapping

from dashred.physics.runge_kutta import EULER, MIDPOINT, SSPRK3, THREE_EIGHTHS, Tableau

METHODS: Mapping[str, Mapping[str, Tableau | None]] = {
    "spectral": {"etdrk4": None},
    "finite-difference": {"ssprk3": SSPRK3},
    "ode": {
        "rk4": THREE_EIGHTHS,
        "dopri5": None,
        "dopri8": None,
        "bosh3": None,
        "midpoint": MIDPOINT,
        "euler": EULER,
    },
}
"""Methods that fit each kind of space, with their tableaux; the first is the default.

One with a tableau takes fixed steps, and is interpreted, compiled and differentiated by it alone.
``etdrk4`` has code of its own (:mod:`dashred.physics.solvers.etdrk4`). The others are torchdiffeq's
adaptive methods.
"""
