"""The port-Hamiltonian structure of the simulator and its change by a law."""

from __future__ import annotations

import torch
from torch import Tensor

from dashred.core.findings.law_schema import PartChange, StructureChanges
from dashred.inference.fit.law import Law
from dashred.inference.results.corrected_system import build_fitted_system
from dashred.inference.results.structure_change import stays_port_hamiltonian, structure_changes
from dashred.physics.port_hamiltonian import PortHamiltonian
from dashred.physics.sampled_states import SampledStates
from dashred.physics.system import System

# Number of states along a trajectory at which a structure is checked.
SAMPLE_COUNT = 20


@torch.no_grad()
def check_structure(system: System, times: Tensor, states: Tensor) -> None:
    """Check the declared structure of a system, if any, against its equations.

    Args:
        system: the simulator.
        times: times of the states, ``(time,)``.
        states: states of a simulation, ``(time, field, *grid)``.

    Raises:
        InputError: see :meth:`dashred.physics.port_hamiltonian.PortHamiltonian.check`.
    """
    if system.config.structure is not None:
        PortHamiltonian.of(system, system.config.structure).check(_sample_states(times, states))


@torch.no_grad()
def structure_change(
    system: System, law: Law, times: Tensor, states: Tensor
) -> StructureChanges | None:
    """Return the change of the structure by a law; None if no structure is declared.

    The structure has the fitted values of uncertain parameters.

    Args:
        system: the simulator.
        law: the law.
        times: times of the states, ``(time,)``.
        states: states of the corrected simulation, ``(time, field, *grid)``.
    """
    if system.config.structure is None or not law.candidates:
        return None
    fitted, sampled_states = build_fitted_system(system, law), _sample_states(times, states)
    form = PortHamiltonian.of(fitted, system.config.structure)
    changes = structure_changes(form, law, sampled_states)
    return StructureChanges(
        changes=[
            PartChange(term=change.candidate, part=change.part, passive=change.passive)
            for change in changes
        ],
        port_hamiltonian=stays_port_hamiltonian(form, law, changes, sampled_states),
    )


def _sample_states(times: Tensor, states: Tensor) -> SampledStates:
    finite = torch.nonzero(torch.isfinite(states.flatten(1)).all(dim=1)).flatten()
    chosen = finite[:: max(1, len(finite) // SAMPLE_COUNT)]
    return SampledStates(states[chosen], times[chosen])
