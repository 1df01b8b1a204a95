"""Run the other methods on one recording: ``python -m dashred.baselines.analyse conf=…``.

Like the analysis it is handed the recording alone. It writes ``baselines.nc``, the fields by
method, and ``baselines.json``: laws, settings, seconds, and the hash that freezes the fields.
"""

from __future__ import annotations

import sys
import time
from collections.abc import Callable
from dataclasses import replace
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING

from dashred.config import Config, load_config
from dashred.errors import DONE, InputError, run_entry

if TYPE_CHECKING:
    from dashred.baselines.estimate import Estimated
    from dashred.stages.problem import Problem

FIELDS, LAWS = "baselines.nc", "baselines.json"


def main(argv: list[str]) -> int:
    """Estimate the field with every method that reads sensors."""
    analyse(load_config(argv, entry="train"))
    return DONE


def analyse(config: Config) -> None:
    """Run every method in turn and write what they found."""
    from dashred.baselines.closed_form import closed_form
    from dashred.baselines.kalman_filter import filter_augmented, filter_state
    from dashred.baselines.optimal_interpolation import optimal_interpolation
    from dashred.baselines.plain_shred import plain_shred
    from dashred.output import make_output
    from dashred.stages import problem, provenance, simulation
    from dashred.tracking import Tracker

    assert config.output is not None
    provenance.prepare_torch(config)
    posed = problem.pose(config)
    if posed.others:
        fault = "the baselines read one episode, and the recording has several"
        raise InputError(fault, where=config.recording.path)
    as_it_is = replace(posed, config=_plain(config))
    nominal = simulation.simulate_nominal(posed, {})
    randomised = simulation.simulate_ensemble(posed, nominal, {})
    plain = simulation.simulate_ensemble(as_it_is, nominal, {})
    keep = config.tracking
    experiment = keep.experiment or config.name
    with Tracker.open(keep.root, experiment, "baselines", parent=keep.parent) as run:
        methods: dict[str, Callable[[], Estimated | None]] = {
            "closed_form": partial(closed_form, posed, nominal.prior),
            "optimal_interpolation": partial(optimal_interpolation, posed, plain),
            "shred_plain": partial(plain_shred, as_it_is, plain, run),
            "filter_state": partial(filter_state, posed, plain),
            "filter_augmented": partial(filter_augmented, posed, randomised),
        }
        found: dict[str, Estimated | None] = {}
        seconds: dict[str, float] = {}
        for name, method in methods.items():
            began = time.perf_counter()
            found[name] = method()
            seconds[name] = time.perf_counter() - began
        _write(make_output(config.output), posed, found, seconds, run.run_id)


def _plain(config: Config) -> Config:
    """Return the configuration with an ensemble of the simulator as it is."""
    return replace(config, simulation=replace(config.simulation, discrepancy=False))


def _write(
    output: Path,
    posed: Problem,
    found: dict[str, Estimated | None],
    seconds: dict[str, float],
    run_id: str,
) -> None:
    from dashred.findings import sha256_of, write_json_atomic
    from dashred.stages.field_files import write_estimates

    known = {name: estimated for name, estimated in found.items() if estimated is not None}
    count = len(posed.split.fit.times)
    fields = {name: estimated.states for name, estimated in known.items()}
    write_estimates(output / FIELDS, posed.system, posed.times[:count], fields)
    methods = {
        name: {
            "seconds": seconds[name],
            "terms": estimated.terms if estimated else None,
            "note": estimated.note if estimated else "not for this system",
        }
        for name, estimated in found.items()
    }
    sha256 = sha256_of(output / FIELDS)
    record = {"methods": methods, "fields_sha256": sha256, "mlflow_run": run_id}
    write_json_atomic(output / LAWS, record)


if __name__ == "__main__":
    sys.exit(run_entry(main))
