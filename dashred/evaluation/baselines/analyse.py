"""Run the other methods on one recording, in a process of its own.

Like the analysis it is handed the recording alone. It writes ``baselines.nc``, the fields by
method, and ``baselines.json``: laws, settings, seconds, failures, and the hash that freezes the
fields. A method that fails takes no other with it.
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
from dashred.core.errors import DONE, InputError, run_entry
from dashred.core.system_errors import describe_system_error

if TYPE_CHECKING:
    from dashred.evaluation.baselines.estimate import Estimated
    from dashred.pipeline.problem import Problem

FIELDS, LAWS = "baselines.nc", "baselines.json"
METHODS = (
    "closed_form",
    "optimal_interpolation",
    "shred_plain",
    "filter_state",
    "filter_augmented",
)
# Of them, those that look for a law.
OF_LAWS = ("closed_form", "filter_augmented")
NOT_FOR_SYSTEM = "not for this system"
LENGTH = 200


@dataclass(frozen=True)
class Ended:
    """How one method ended.

    Attributes:
        found: None where the system is none for this method, or it failed.
        failed: of what, in words; None where it did not.
        seconds: its own, and those of the simulations that it learns from.
    """

    found: Estimated | None
    failed: str | None
    seconds: float


def main(argv: list[str]) -> int:
    """Estimate the field with every method that reads sensors."""
    analyse(load_config(argv, entry="train"))
    return DONE


def analyse(config: Config) -> None:
    """Run every method in turn and write what they found."""
    from dashred.core.mlflow.tracker import Tracker
    from dashred.evaluation.baselines.closed_form import closed_form
    from dashred.evaluation.baselines.kalman_filter import filter_augmented, filter_state
    from dashred.evaluation.baselines.optimal_interpolation import optimal_interpolation
    from dashred.evaluation.baselines.plain_shred import plain_shred
    from dashred.pipeline import problem, simulation
    from dashred.pipeline.discovery.identifiable_terms import keep_identifiable_terms
    from dashred.pipeline.run import provenance
    from dashred.pipeline.run.output_dir import make_output

    assert config.output is not None
    provenance.prepare_torch(config)
    posed = problem.build_problem(config)
    if posed.others:
        fault = "the baselines read one episode, and the recording has several"
        raise InputError(fault, where=config.recording.path)
    nominal = simulation.simulate_nominal(posed, {})
    posed = keep_identifiable_terms(posed, nominal.states, posed.times)
    as_it_is = replace(posed, config=_plain(config))
    of_plain: dict[str, float] = {}
    plain = simulation.simulate_ensemble(as_it_is, nominal, of_plain)
    keep = config.tracking
    experiment = keep.experiment or config.name
    with Tracker.open(keep.root, experiment, "baselines", parent=keep.parent) as run:
        methods: dict[str, tuple[Callable[[], Estimated | None], dict[str, float]]] = {
            "closed_form": (partial(closed_form, posed, nominal.prior), {}),
            "optimal_interpolation": (partial(optimal_interpolation, posed, plain), of_plain),
            "shred_plain": (partial(plain_shred, as_it_is, plain, run), of_plain),
            "filter_state": (partial(filter_state, posed, plain), of_plain),
            "filter_augmented": (partial(filter_augmented, posed, plain, nominal.states), of_plain),
        }
        ended = {
            name: attempt(method, sum(simulations.values()))
            for name, (method, simulations) in methods.items()
        }
        _write(make_output(config.output), posed, ended, run.run_id)


def attempt(method: Callable[[], Estimated | None], simulated: float) -> Ended:
    """Run one method; whatever it dies of is its own failure, told and kept.

    Args:
        method: without arguments.
        simulated: seconds of the simulations that it was handed.

    Raises:
        Exception: what the machine or the store has refused is no failure of a method.
    """
    began = time.perf_counter()
    found, failed = None, None
    try:
        found = method()
    except InputError:
        raise
    except Exception as error:
        failed = own_failure(error)
    if found is not None and not bool(found.states.isfinite().all()):
        found, failed = None, "its field is not finite"
    return Ended(found, failed, simulated + time.perf_counter() - began)


def own_failure(error: Exception) -> str:
    """Print the trace of what a method died of, and return it on one line.

    Raises:
        Exception: this one, where the machine or the store has refused something.
    """
    if isinstance(error, OSError | MemoryError) or describe_system_error(error):
        raise error
    traceback.print_exc()
    return f"{type(error).__name__}: {' '.join(str(error).split())}"[:LENGTH]


def _plain(config: Config) -> Config:
    """Return the configuration with an ensemble of the simulator as it is."""
    return replace(config, simulation=replace(config.simulation, discrepancy=False))


def _write(output: Path, posed: Problem, ended: dict[str, Ended], run_id: str) -> None:
    from dashred.core.findings.findings import sha256_of, write_json_atomic
    from dashred.pipeline.outputs.field_files import write_estimates

    fields = {name: one.found.states for name, one in ended.items() if one.found is not None}
    count = len(posed.split.fit.times)
    sha256 = None
    if fields:
        write_estimates(output / FIELDS, posed.system, posed.times[:count], fields)
        sha256 = sha256_of(output / FIELDS)
    methods = {
        name: {
            "seconds": one.seconds,
            "terms": one.found.terms if one.found else None,
            "note": one.found.note if one.found else "" if one.failed else NOT_FOR_SYSTEM,
            "failed": one.failed,
        }
        for name, one in ended.items()
    }
    record = {"methods": methods, "fields_sha256": sha256, "mlflow_run": run_id}
    write_json_atomic(output / LAWS, record)


if __name__ == "__main__":
    sys.exit(run_entry(main))
