"""Time steppers by name."""

from __future__ import annotations

from collections.abc import Mapping

from dashred.physics.runge_kutta import CLASSICAL, EULER, MIDPOINT, SSPRK3, THREE_EIGHTHS, Tableau

METHODS: Mapping[str, Mapping[str, Tableau | None]] = {
    "spectral": {"etdrk4": None},
    "finite-difference": {"ssprk3": SSPRK3},
    "finite-volume": {"etdrk4": None},
    "nodes": {"rk4": CLASSICAL},
    "ode": {
        "rk4": THREE_EIGHTHS,
        "dopri5": None,
        "dopri8": None,
        "bosh3": None,
        "midpoint": MIDPOINT,
        "euler": EULER,
    },
}
"""Methods for each kind of spatial discretisation, with their tableaux; the first is the default.

A method with a tableau takes fixed steps; its interpreted, compiled and differentiated versions
all use the tableau. ``etdrk4`` is in :mod:`dashred.physics.solvers.etdrk4`, and for finite volumes
in :mod:`dashred.physics.cells.integrate`. The others are the adaptive methods of torchdiffeq.
"""
