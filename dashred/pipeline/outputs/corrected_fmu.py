"""Write `corrected.fmu`: the FMU of the user with the law added, for other tools."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import torch
from torch import Tensor

from dashred.inference.fit.law import Law
from dashred.inference.results.corrected_system import build_corrected_system
from dashred.inference.results.explanation import terms_of_law
from dashred.physics.backends.input_signals import InputSignals
from dashred.physics.expressions.algebra import ZERO
from dashred.physics.external.adapter import ANY_TIME
from dashred.physics.external.adapters.fmu.corrected.archive import write_fmu
from dashred.physics.external.adapters.fmu.corrected.library import Correction, NotPossibleError
from dashred.physics.external.adapters.fmu.description import (
    INTERFACES,
    MODEL_EXCHANGE,
    Description,
    read_description,
)
from dashred.physics.external.adapters.fmu.fmu import FmuAdapter
from dashred.physics.external.program import describe_fmu
from dashred.physics.external.state_batch import ProgramError, StateBatch
from dashred.physics.external.stepped_fields import stepped_fields
from dashred.physics.solvers.simulate import simulate
from dashred.physics.solvers.splitting import ProgramFlow
from dashred.physics.system import System
from dashred.pipeline.problem import Problem
from dashred.pipeline.trajectories import Trajectories
from dashred.reporting.wording.findings_text import law_text

NAME = "corrected.fmu"
# It is run from so many states of the corrected simulation. For model exchange the step is short,
# so that splitting has no error; the share is that of the largest change by the law.
CHECKED, PART_OF_STEP, SHARE, ROUNDING = 4, 1 / 16, 0.02, 1e-9


def write_corrected_fmu(
    path: Path, problem: Problem, law: Law, runs: Trajectories, remark: str
) -> str:
    """Write an FMU of the corrected simulator, if the simulator is an FMU, and run it.

    Args:
        path: of the new FMU.
        problem: with the system.
        law: what is added to it.
        runs: the corrected simulation, from which it is started.
        remark: on the law, for its model description.

    Returns:
        What is told of it: where it is, or why there is none. Empty without an FMU or a law.
    """
    system = problem.system
    simulator = system.config.simulator
    if simulator is None or simulator.fmu is None:
        return ""
    corrected = build_corrected_system(system, law)
    fields = stepped_fields(corrected.config)
    added = {name: corrected.without_lets(corrected.equations[name]) for name in fields}
    is_same = corrected.config.parameters == system.config.parameters
    if is_same and all(expr == ZERO for expr in added.values()):
        return ""
    description = describe_fmu(system.config, system.where("system.simulator.fmu"))
    correction = Correction(added, corrected.config.parameters, corrected.dt)
    told = law_text(terms_of_law(system, law), system)
    words = f"Corrected by dashred. {told} {remark}".strip()
    try:
        write_fmu(path, description, correction, words)
        _check(path, description, corrected, runs)
    except NotPossibleError as error:
        path.unlink(missing_ok=True)
        return f"There is no {NAME}: {error}."
    return f"{NAME} is an FMU of the corrected simulator, for other tools."


def _check(path: Path, original: Description, corrected: System, runs: Trajectories) -> None:
    """Run an FMU for a step from states of a corrected simulation.

    Raises:
        NotPossibleError: it fails, or does not do what the corrected simulation does.
    """
    fields = stepped_fields(corrected.config)
    places = [corrected.fields.index(name) for name in fields]
    new = FmuAdapter(_description(path, original, fields), fields, "")
    length = corrected.dt * (PART_OF_STEP if original.kind == MODEL_EXCHANGE else 1)
    changes, errors, size = [], [], 0.0
    for state, t in _states(runs):
        held = _with_inputs_at(corrected, t + length / 2)
        clock = torch.tensor([t, t + length], dtype=torch.float64)
        expected = simulate(held, state[None], clock)[0, -1].numpy()
        flow = ProgramFlow(held)
        each = np.array([t]), np.array([length])
        batch = StateBatch(state[None, places].numpy(), *each, flow.inputs(*each), flow.parameters)
        try:
            [found] = new.call(batch, ANY_TIME)
        except ProgramError as error:
            raise NotPossibleError(f"it {error}") from None
        without = flow(state[None], t, length)[0].numpy()
        changes.append(np.abs(expected - without).max())
        errors.append(np.abs(expected[places] - found).max())
        size = max(size, np.abs(expected).max())
    if errors and not max(errors) <= SHARE * max(changes) + ROUNDING * size:
        raise NotPossibleError("in a test run it did not do what the corrected simulator does")


def _states(runs: Trajectories) -> list[tuple[Tensor, float]]:
    """Return a few states of the corrected simulation with their times."""
    states = runs.states["corrected"][: runs.recorded]
    picked = np.linspace(0, len(states) - 1, CHECKED).astype(int)
    return [(states[i], float(runs.times[i])) for i in picked if states[i].isfinite().all()]


def _with_inputs_at(system: System, t: float) -> System:
    """Return a system whose inputs keep their values at a time."""
    values = {name: np.atleast_1d(value) for name, value in system.input_signals.at(t).items()}
    return system.with_input_signals(InputSignals(np.zeros(1), values))


def _description(path: Path, original: Description, fields: tuple[str, ...]) -> Description:
    """Return the description of a new FMU, with the variables of the original."""
    named = dict(zip(fields, original.fields, strict=True)) | dict(original.others)
    variables = {name: variable.name for name, variable in named.items()}
    [interface] = [name for name, kind in INTERFACES.items() if kind == original.kind]
    return read_description(str(path), fields, original.others, variables, interface, str(path))
