"""What a run does with the simulator before it learns: its structure, and its ensemble."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np
import torch

from dashred.core.errors import InputError
from dashred.physics.runs.ensemble import Discrepancies, draw_round
from dashred.pipeline.check.context import STREAM, CheckContext
from dashred.pipeline.check.placeholders import still
from dashred.pipeline.check.remark import Remark, doubtful
from dashred.pipeline.check.run_time import BATCHED
from dashred.pipeline.check.simulator import Simulated
from dashred.pipeline.verification.structure import check_structure

# Members that are tried at once, rounds, and the seconds that a round may take.
MEMBERS, ROUNDS, SECONDS = 8, 3, 1.0
# A run draws twenty rounds: where fewer than this share stay within bounds, that is not enough.
FEW = 0.2


def about_structure(situation: CheckContext, simulated: Simulated) -> Iterator[Remark]:
    """Tell of a port-Hamiltonian structure that does not make the equations."""
    if situation.config.system.structure is None:
        return
    try:
        check_structure(situation.system, simulated.times, simulated.states)
    except InputError as error:
        where = f"{error.where}: " if error.where else ""
        yield Remark(f"{where}{error.what}", "wrong", error.hint)
    else:
        yield Remark("It has the structure that it claims")


@torch.no_grad()
def about_ensemble(situation: CheckContext, simulated: Simulated) -> Iterator[Remark]:
    """Say whether simulations such as a run learns from stay within bounds.

    They are followed for as long as there is time; who leaves early has left.
    """
    settings, system = situation.config.simulation, situation.system
    fitted = len(situation.split.fit.times)
    if still(situation.config) or len(simulated.times) < fitted:
        return
    stepped = system if settings.dt is None else system.with_step(settings.dt)
    discrepancies = None
    if settings.discrepancy:
        discrepancies = Discrepancies(situation.library, settings.terms, settings.amplitude)
    times = simulated.times[: min(fitted, simulated.affordable(SECONDS, BATCHED * MEMBERS))]
    nominal, rng = simulated.states[:fitted], np.random.default_rng([situation.config.seed, STREAM])
    tried = inside = 0
    while tried < ROUNDS * MEMBERS and inside < MEMBERS / 2:
        *_, stay = draw_round(stepped, times, simulated.prior, nominal, MEMBERS, discrepancies, rng)
        tried, inside = tried + MEMBERS, inside + int(stay.sum())
    says = f"Of {tried} simulations such as a run learns from {inside} stay within bounds"
    hint = "make system.spread or simulation.amplitude smaller"
    if not inside:
        yield Remark(says, "wrong", hint)
    elif inside < FEW * tried:
        yield doubtful(f"{says}: a run may find too few", hint)
