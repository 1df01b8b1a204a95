"""The port-Hamiltonian structure of the simulator, and what a law does to it."""

from __future__ import annotations

import torch
from torch import Tensor

from dashred.core.findings.law_schema import StructureChanged, StructureFound
from dashred.inference.fit.law import Law
from dashred.inference.results.structure_change import stays_port_hamiltonian, structure_changes
from dashred.physics.port_hamiltonian import PortHamiltonian
from dashred.physics.sampled_states import SampledStates
from dashred.physics.system import System

# States, spread evenly over a trajectory, at which a structure is looked at.
STATES = 20


@torch.no_grad()
def check_structure(system: System, times: Tensor, states: Tensor) -> None:
    """Hold the structure that a system claims, if it claims one, against its equations.

    Args:
        system: the simulator.
        times: of the states, ``(time,)``.
        states: of a simulation, ``(time, field, *grid)``.

    Raises:
        InputError: see :meth:`dashred.physics.port_hamiltonian.PortHamiltonian.check`.
    """
    if system.config.structure is not None:
        PortHamiltonian.of(system, system.config.structure).check(_some(times, states))


@torch.no_grad()
def structure_changed(
    system: System, law: Law, times: Tensor, states: Tensor
) -> StructureFound | None:
    """Return what a law does to the structure; null where none is claimed.

    Args:
        system: the simulator.
        law: what it leaves out.
        times: of the states, ``(time,)``.
        states: of the corrected simulation, ``(time, field, *grid)``.
    """
    if system.config.structure is None or not law.candidates:
        return None
    form, visited = PortHamiltonian.of(system, system.config.structure), _some(times, states)
    changes = structure_changes(form, law, visited)
    return StructureFound(
        changes=[
            StructureChanged(term=change.candidate, part=change.part, passive=change.passive)
            for change in changes
        ],
        port_hamiltonian=stays_port_hamiltonian(form, law, changes, visited),
    )


def _some(times: Tensor, states: Tensor) -> SampledStates:
    finite = torch.nonzero(torch.isfinite(states.flatten(1)).all(dim=1)).flatten()
    chosen = finite[:: max(1, len(finite) // STATES)]
    return SampledStates(states[chosen], times[chosen])
