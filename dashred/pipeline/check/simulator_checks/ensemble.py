"""Checks of the declared structure and of the training ensemble."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np
import torch

from dashred.core.errors import InputError
from dashred.physics.runs.ensemble import Discrepancies, MemberSource, draw_round
from dashred.pipeline.check.context import STREAM, CheckContext
from dashred.pipeline.check.placeholders import zero_equations
from dashred.pipeline.check.remark import Remark, warning
from dashred.pipeline.check.simulator_checks.run_time import BATCHED
from dashred.pipeline.check.simulator_checks.simulator import NominalRun
from dashred.pipeline.verification.structure import check_structure

# Members per round, number of rounds, and seconds per round.
MEMBERS, ROUNDS, SECONDS = 8, 3, 1.0
# A run draws up to twenty rounds. Below this share of bounded members they may be too few.
MIN_BOUNDED = 0.2


def structure_remarks(context: CheckContext, nominal: NominalRun) -> Iterator[Remark]:
    """Check the port-Hamiltonian structure against the equations."""
    if context.config.system.structure is None:
        return
    try:
        check_structure(context.system, nominal.times, nominal.states)
    except InputError as error:
        where = f"{error.where}: " if error.where else ""
        yield Remark(f"{where}{error.what}", "error", error.hint)
    else:
        yield Remark("The declared structure reproduces the equations")


@torch.no_grad()
def ensemble_remarks(context: CheckContext, nominal: NominalRun) -> Iterator[Remark]:
    """Check that members of the training ensemble stay within bounds, as far as time allows."""
    settings, system = context.config.simulation, context.system
    fitted = len(context.split.fit.times)
    if zero_equations(context.config) or len(nominal.times) < fitted:
        return
    stepped = system if settings.dt is None else system.with_step(settings.dt)
    discrepancies = None
    if settings.discrepancy:
        discrepancies = Discrepancies(context.library, settings.terms, settings.amplitude)
    times = nominal.times[: min(fitted, nominal.affordable_samples(SECONDS, BATCHED * MEMBERS))]
    states, rng = nominal.states[:fitted], np.random.default_rng([context.config.seed, STREAM])
    source = MemberSource(stepped, times, nominal.prior, states, discrepancies, rng)
    tried = bounded = 0
    while tried < ROUNDS * MEMBERS and bounded < MEMBERS / 2:
        *_, stay = draw_round(source, MEMBERS)
        tried, bounded = tried + MEMBERS, bounded + int(stay.sum())
    text = f"{bounded} of {tried} members of the training ensemble stay within bounds"
    hint = "decrease system.spread or simulation.amplitude"
    if not bounded:
        yield Remark(text, "error", hint)
    elif bounded < MIN_BOUNDED * tried:
        yield warning(f"{text}: a run may not get enough members", hint)
