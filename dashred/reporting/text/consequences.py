"""What a law changes in a system's energy and in its structure, as text."""

from collections.abc import Mapping
from typing import Any

from dashred.core.formatting import with_error

PARTS = {
    "H": "H, the energy",
    "J": "J, the exchange of energy",
    "R": "R, the dissipation",
    "G": "G, the input",
    None: "no single part of the structure",
}


def consequences(findings: Mapping[str, Any]) -> list[str]:
    """Return what the law changes in the system's energy and in its structure."""
    return [*_energy(findings["energy"]), *_structure(findings["structure"])]


def _energy(energy: Mapping[str, Any] | None) -> list[str]:
    """Return how much energy the corrected system loses or gains per cycle."""
    if energy is None:
        return []
    first, last = (_share(energy[name]) for name in ("first", "last"))
    cycles = energy["cycles"]
    return [
        f"The energy of the corrected system {first} in the first cycle and {last} in the last of "
        f"{cycles} cycles."
    ]


def _structure(found: Mapping[str, Any] | None) -> list[str]:
    """Return the parts of a port-Hamiltonian system that change, and whether it remains one."""
    if found is None:
        return []
    kept = found["port_hamiltonian"]
    remains = "remains" if kept else "is not"
    changes = "; ".join(f"{each['term']} changes {_part(each, kept)}" for each in found["changes"])
    return [f"{changes}. The corrected system {remains} port-Hamiltonian."]


def _part(change: Mapping[str, Any], kept: bool) -> str:
    if change["part"] == "R" and not change["passive"]:
        return "R, and reduces the dissipation" if kept else "R, and adds energy"
    return PARTS[change["part"]]


def _share(share: Mapping[str, Any]) -> str:
    size = with_error(100 * abs(share["lost"]), 100 * share["std"])
    return f"{'decreases' if share['lost'] >= 0 else 'increases'} by {size} %"
