"""The other methods, and which of them are asked about a case."""

from __future__ import annotations

from dashred.evaluation.foreign.cases.case import Collection, Kind

PEERS: dict[str, str] = {
    "weak_sindy": "PySINDy, weak form, full state",
    "ensemble_sindy": "PySINDy, ensemble, full state",
    "pde_find": "PDE-FIND, full field",
    "filter": "ensemble filter with coefficients, sensors",
}
_STATES = ("weak_sindy", "ensemble_sindy", "filter")
ASKED: dict[Collection, tuple[str, ...]] = {
    "dysts": _STATES,
    "mechanics": _STATES,
    "fields": ("pde_find", "filter"),
}
# They can only name a law, or none.
KINDS: tuple[Kind, ...] = ("term", "nothing")
