"""The other methods, and which of them are asked about a case."""

from __future__ import annotations

from dashred.evaluation.foreign.cases.case import Kind

PEERS: dict[str, str] = {
    "weak_sindy": "PySINDy, weak form, full state",
    "ensemble_sindy": "PySINDy, ensemble, full state",
    "weak_pde": "PDE-FIND, weak form, full field",
    "pde_find": "PDE-FIND, full field",
    "filter": "ensemble filter with coefficients, sensors",
}
# By the number of axes.
ASKED: dict[int, tuple[str, ...]] = {
    0: ("weak_sindy", "ensemble_sindy", "filter"),
    1: ("weak_pde", "pde_find", "filter"),
    2: ("pde_find", "filter"),
}
# They can only name a law, or none.
KINDS: tuple[Kind, ...] = ("term", "nothing")
