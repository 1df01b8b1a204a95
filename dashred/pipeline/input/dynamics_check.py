"""Check that the simulator can be stepped inside of the assimilation."""

from __future__ import annotations

from dashred.core.errors import InputError
from dashred.physics.solvers.sample_step import is_differentiable
from dashred.pipeline.problem import Problem


def check_dynamics(problem: Problem) -> None:
    """Check that an assimilation with dynamics, if one is asked for, can step the simulator.

    Raises:
        InputError: it cannot.
    """
    config = problem.config
    if not config.assimilation.dynamics:
        return
    if config.assimilation.encoder_rate > 0:
        raise InputError(
            "assimilation.dynamics=true freezes SHRED's LSTM, but assimilation.encoder_rate > 0 "
            "trains it",
            where=config.where("assimilation.encoder_rate"),
            hint="choose assimilation.encoder_rate=0, or assimilation.dynamics=false",
        )
    if problem.snapshots is None and is_differentiable(problem.system):
        return
    raise InputError(
        "assimilation.dynamics needs equations with a fixed explicit step: no snapshots, no "
        "program, no boundary conditions, and no adaptive method",
        where=config.where("assimilation.dynamics"),
        hint="choose assimilation.dynamics=false",
    )
