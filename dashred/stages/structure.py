"""The port-Hamiltonian structure of the simulator, and what a law does to it."""

from __future__ import annotations

import torch
from torch import Tensor

from dashred.discovery.law import Law
from dashred.discovery.structure_change import structure_changes
from dashred.law_schema import StructureChanged
from dashred.physics.port_hamiltonian import PortHamiltonian
from dashred.physics.system import System

# States, spread evenly over a trajectory, at which a structure is looked at.
STATES = 20


@torch.no_grad()
def check_structure(system: System, states: Tensor) -> None:
    """Hold the structure that a system claims, if it claims one, against its equations.

    Args:
        system: the simulator.
        states: of a simulation, ``(time, field, *grid)``.

    Raises:
        InputError: see :meth:`dashred.physics.port_hamiltonian.PortHamiltonian.check`.
    """
    if system.config.structure is not None:
        PortHamiltonian.of(system, system.config.structure).check(_some(states))


@torch.no_grad()
def structure_changed(system: System, law: Law, states: Tensor) -> list[StructureChanged] | None:
    """Return which part each term of a law changes; null where no structure is claimed.

    Args:
        system: the simulator.
        law: what it leaves out.
        states: of the corrected simulation, ``(time, field, *grid)``.
    """
    if system.config.structure is None or not law.candidates:
        return None
    form = PortHamiltonian.of(system, system.config.structure)
    return [
        StructureChanged(term=change.candidate, part=change.part, passive=change.passive)
        for change in structure_changes(form, law, _some(states))
    ]


def _some(states: Tensor) -> Tensor:
    finite = states[torch.isfinite(states.flatten(1)).all(dim=1)]
    return finite[:: max(1, len(finite) // STATES)]
