"""Run the other methods on one recording, in a process of its own.

Like the analysis it is handed the recording alone. It writes ``baselines.nc``, the fields by
method, and ``baselines.json``: laws, settings, seconds, failures, and the hash that freezes the
fields. The failure of a method does not affect the others.
"""

from __future__ import annotations

import sys
import time
import traceback
from collections.abc import Callable
from dataclasses import dataclass, replace
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING

from dashred.config import Config, load_config
from dashred.core.command_line.entry import run_entry
from dashred.core.errors import DONE, InputError
from dashred.core.system_errors import describe_system_error

if TYPE_CHECKING:
    from dashred.evaluation.baselines.estimate import Estimate
    from dashred.pipeline.problem import Problem

FIELDS, LAWS = "baselines.nc", "baselines.json"
METHODS = (
    "closed_form",
    "optimal_interpolation",
    "shred_plain",
    "pyshred",
    "pyshred_tuned",
    "filter_state",
    "filter_augmented",
)
# Methods among them that seek a law.
LAW_METHODS = ("closed_form", "filter_augmented")
NOT_FOR_SYSTEM = "not for this system"
MAX_LENGTH = 200


@dataclass(frozen=True)
class Outcome:
    """Outcome of one method.

    Attributes:
        found: the estimate; None if the method does not apply to the system or failed.
        failed: cause of the failure; None if the method did not fail.
        seconds: run time, including that of the simulations that it learns from.
    """

    found: Estimate | None
    failed: str | None
    seconds: float


def main(argv: list[str]) -> int:
    """Estimate the field with every method that reads sensors."""
    analyse(load_config(argv, entry="train"))
    return DONE


def analyse(config: Config) -> None:
    """Run all methods in turn and write their results."""
    from dashred.core.mlflow.tracker import Tracker
    from dashred.evaluation.baselines.closed_form import closed_form
    from dashred.evaluation.baselines.kalman_filter import filter_augmented, filter_state
    from dashred.evaluation.baselines.optimal_interpolation import optimal_interpolation
    from dashred.evaluation.baselines.plain_shred import plain_shred
    from dashred.evaluation.baselines.pyshred_field import (
        is_installed,
        pyshred_recommended,
        pyshred_tuned,
    )
    from dashred.evaluation.baselines.single_episode import single_episode
    from dashred.pipeline.discovery.identifiable_terms import keep_identifiable_terms
    from dashred.pipeline.run.output_dir import make_output
    from dashred.pipeline.simulation.ensembles import simulate_ensemble
    from dashred.pipeline.simulation.nominal_run import simulate_nominal
    from dashred.pipeline.simulation.state_samples import StateSamples

    assert config.output is not None
    problem = single_episode(config)
    with problem.scratch.removed_at_the_end():
        nominal = simulate_nominal(problem, {})
        problem = keep_identifiable_terms(
            problem, StateSamples(problem.system, nominal.states, problem.times)
        )
        unchanged = replace(problem, config=_plain(config))
        plain_seconds: dict[str, float] = {}
        plain = simulate_ensemble(unchanged, nominal, plain_seconds)
        keep = config.tracking
        experiment = keep.experiment or config.name
        with Tracker.open(
            keep.root, experiment, "baselines", parent=keep.parent, artifacts=keep.artifacts
        ) as run:
            methods: dict[str, tuple[Callable[[], Estimate | None], dict[str, float]]] = {
                "closed_form": (partial(closed_form, problem, nominal.prior), {}),
                "optimal_interpolation": (
                    partial(optimal_interpolation, problem, plain),
                    plain_seconds,
                ),
                "shred_plain": (partial(plain_shred, unchanged, plain, run), plain_seconds),
                "filter_state": (partial(filter_state, problem, plain), plain_seconds),
                "filter_augmented": (
                    partial(filter_augmented, problem, plain, nominal.states),
                    plain_seconds,
                ),
            }
            if is_installed():
                methods["pyshred"] = partial(pyshred_recommended, problem, plain), plain_seconds
                methods["pyshred_tuned"] = partial(pyshred_tuned, problem, plain), plain_seconds
            ended = {
                name: attempt(method, sum(simulations.values()))
                for name, (method, simulations) in methods.items()
            }
            _write(make_output(config.output), problem, ended, run.run_id)


def attempt(method: Callable[[], Estimate | None], simulated: float) -> Outcome:
    """Run one method and record its failure, if any.

    Args:
        method: the method, without arguments.
        simulated: seconds of the simulations that it uses.

    Raises:
        Exception: an error of the machine or the store, which is not a failure of the method.
    """
    started = time.perf_counter()
    found, failed = None, None
    try:
        found = method()
    except InputError:
        raise
    except Exception as error:
        failed = failure_text(error)
    if found is not None and not bool(found.states.isfinite().all()):
        found, failed = None, "its field is not finite"
    return Outcome(found, failed, simulated + time.perf_counter() - started)


def failure_text(error: Exception) -> str:
    """Print the traceback of a failure and return its message on one line.

    Raises:
        Exception: the error itself, if it is an error of the machine or the store.
    """
    if isinstance(error, OSError | MemoryError) or describe_system_error(error):
        raise error
    traceback.print_exc()
    return f"{type(error).__name__}: {' '.join(str(error).split())}"[:MAX_LENGTH]


def _plain(config: Config) -> Config:
    """Return the configuration with an ensemble of the unchanged simulator."""
    return replace(config, simulation=replace(config.simulation, discrepancy=False))


def _write(output: Path, problem: Problem, ended: dict[str, Outcome], run_id: str) -> None:
    from dashred.core.findings.findings import sha256_of, write_json_atomic
    from dashred.pipeline.outputs.field_files import write_estimates

    fields = {
        name: outcome.found.states for name, outcome in ended.items() if outcome.found is not None
    }
    count = len(problem.split.fit.times)
    sha256 = None
    if fields:
        write_estimates(output / FIELDS, problem.system, problem.times[:count], fields)
        sha256 = sha256_of(output / FIELDS)
    methods = {
        name: {
            "seconds": outcome.seconds,
            "terms": outcome.found.terms if outcome.found else None,
            "note": outcome.found.note
            if outcome.found
            else ""
            if outcome.failed
            else NOT_FOR_SYSTEM,
            "failed": outcome.failed,
        }
        for name, outcome in ended.items()
    }
    record = {"methods": methods, "fields_sha256": sha256, "mlflow_run": run_id}
    write_json_atomic(output / LAWS, record)


if __name__ == "__main__":
    sys.exit(run_entry(main))
