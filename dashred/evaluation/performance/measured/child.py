"""Measure one setting in a process of its own; the result is one line of JSON.

``python -m dashred.evaluation.performance.measured.child '{"setting": {…}, "pieces": […], …}'``.
The peak of the memory belongs to the process, so each row needs its own. Seconds are those of the
CPU: with one thread, those of the clock on an idle machine. Other jobs hardly change them.
"""

from __future__ import annotations

import json
import resource
import sys
import time
from dataclasses import asdict
from statistics import median
from typing import Any

import torch

from dashred.core.threads import use_threads
from dashred.core.work import work_done
from dashred.evaluation.performance.measured.floor import Scheme
from dashred.evaluation.performance.measured.problem import UnitProblem
from dashred.evaluation.performance.measured.rates import measure_rates
from dashred.evaluation.performance.measured.setting import PIECES, Setting
from dashred.physics.solvers.schedule import count_steps
from dashred.physics.tangents.semilinear_rhs import forced_semilinear_form
from dashred.physics.tangents.sources import Sources


def measure(setting: Setting, pieces: list[str], repeats: int, floor: bool) -> dict[str, Any]:
    """Return seconds, work and memory of the pieces, and the floor if it is asked for.

    Args:
        setting: sizes of the problem.
        pieces: names of the pieces.
        repeats: how often each is timed.
        floor: whether the rates of the machine are measured, too.
    """
    use_threads(1)
    torch.set_num_threads(1)
    problem = UnitProblem(setting)
    problem.warm_up()
    found: dict[str, Any] = {"before": _peak_memory(), "pieces": {}}
    for name in PIECES:
        if name in pieces:
            found["pieces"][name] = _timed(problem, name, repeats)
    found["memory"] = _peak_memory()
    if floor:
        found["floor"] = _floor(problem, setting)
    return found


def _timed(problem: UnitProblem, name: str, repeats: int) -> dict[str, Any]:
    """Return the CPU seconds of a piece, and its work."""
    seconds, before = [], work_done()
    for _ in range(repeats):
        began = time.process_time()
        problem.pieces[name]()
        seconds.append(time.process_time() - began)
    work = {kind: (count - before.get(kind, 0)) // repeats for kind, count in work_done().items()}
    return {"seconds": min(seconds), "median": median(seconds), "work": work}


def _floor(problem: UnitProblem, setting: Setting) -> dict[str, Any]:
    """Return the rates and what the march and the columns need."""
    objective, system = problem.objective, problem.system
    model, (_, xi) = objective.forward_model, objective.split(problem.phi)
    law, columns = model.law, len(problem.phi)
    sources = Sources(system, law.sources(xi), model.modes)
    form = forced_semilinear_form(system, law.forcing(xi))
    scheme = Scheme.of(form, system.grid.shape, sources.rows)
    rates = measure_rates(setting.points)
    steps = count_steps(model.times[:, 0].tolist(), system.dt)
    needs = {
        "march": scheme.march_step(),
        "columns": scheme.jacobian(columns, steps, setting.samples - 1).times(
            1 / (columns * steps)
        ),
    }
    return {
        "rates": asdict(rates),
        "scheme": asdict(scheme),
        **{
            name: {
                "seconds": need.seconds(rates),
                "operations": need.all_operations(scheme.points),
                "bytes": need.bytes,
                "transforms": need.transforms64 + need.transforms32,
            }
            for name, need in needs.items()
        },
    }


def _peak_memory() -> float:
    """Return the largest memory of this process so far, in MiB."""
    peak = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss
    # In KiB, but on macOS in bytes.
    return peak / (2**20 if sys.platform == "darwin" else 2**10)


def main(text: str) -> None:
    """Measure what a text in JSON asks for, and print the result."""
    asked = json.loads(text)
    setting = Setting(**asked["setting"])
    print(json.dumps(measure(setting, asked["pieces"], asked["repeats"], asked["floor"])))


if __name__ == "__main__":
    main(sys.argv[1])
