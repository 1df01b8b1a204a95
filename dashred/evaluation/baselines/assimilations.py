"""Fit the networks alone to one recording, in several variants, in a process of its own.

Like the analysis it is handed the recording alone. It writes ``assimilations.nc``, the fields by
method, and ``assimilations.json``: the laws that the networks propose, seconds, and the hash that
freezes the fields. The fit through the simulator is not run.
"""

from __future__ import annotations

import sys
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import TYPE_CHECKING, Any, Literal

from dashred.config import Config, load_config
from dashred.core.command_line.entry import run_entry
from dashred.core.errors import DONE

if TYPE_CHECKING:
    from torch import Tensor

    from dashred.evaluation.baselines.estimate import ParameterEntry, TermEntry
    from dashred.inference.latent_sindy.sparse_regression import SparseFit
    from dashred.physics.system import Term
    from dashred.pipeline.problem import Problem
    from dashred.pipeline.simulation.nominal_run import NominalRun

FIELDS, LAWS = "assimilations.nc", "assimilations.json"


@dataclass(frozen=True)
class Variant:
    """What a variant of the assimilation has.

    Attributes:
        random_laws: whether the members that SHRED learns from have random laws.
        dynamics: whether the steps of the simulator are fitted too.
        adapter: whether the decoder gets an adapter.
        residual: what the errors of the steps are measured in.
    """

    random_laws: bool = True
    dynamics: bool = True
    adapter: bool = True
    residual: Literal["fields", "alg1", "alg2"] = "fields"

    @property
    def law(self) -> str:
        """The method that proposes the law of the variant."""
        return self.residual if self.residual != "fields" else "dynamics"

    def of(self, config: Config) -> Config:
        """Return the configuration with this variant."""
        assimilation = replace(
            config.assimilation,
            dynamics=self.dynamics,
            adapter=self.adapter,
            residual=self.residual,
        )
        simulation = replace(config.simulation, discrepancy=self.random_laws)
        return replace(config, assimilation=assimilation, simulation=simulation)


VARIANTS = {
    "sensors_alone": Variant(dynamics=False, adapter=False),
    "dynamics": Variant(),
    "dynamics_without_adapter": Variant(adapter=False),
    "dynamics_without_random_laws": Variant(random_laws=False),
    "dynamics_of_algorithm_1": Variant(residual="alg1"),
    "dynamics_of_algorithm_2": Variant(residual="alg2"),
}


@dataclass
class Found:
    """What the networks have found.

    Attributes:
        states: fields by method, ``(time, field, *grid)``.
        laws: laws by variant, and by method that proposes them.
        seconds: run time by variant, with that of the training.
    """

    states: dict[str, Tensor] = field(default_factory=dict)
    laws: dict[str, dict[str, list[TermEntry | ParameterEntry]]] = field(default_factory=dict)
    seconds: dict[str, float] = field(default_factory=dict)


def main(argv: list[str]) -> int:
    """Fit all variants to a recording."""
    analyse(load_config(argv, entry="train"))
    return DONE


def analyse(config: Config) -> None:
    """Fit all variants and write their fields and laws.

    Raises:
        InputError: the recording has several episodes.
    """
    from dashred.evaluation.baselines.single_episode import single_episode
    from dashred.pipeline.discovery.identifiable_terms import keep_identifiable_terms
    from dashred.pipeline.simulation.longer_step import with_longer_step
    from dashred.pipeline.simulation.nominal_run import simulate_nominal
    from dashred.pipeline.simulation.state_samples import state_samples

    assert config.output is not None
    problem = single_episode(config)
    with problem.scratch.removed_at_the_end():
        nominal = simulate_nominal(problem, {})
        problem = keep_identifiable_terms(problem, state_samples(problem, nominal))
        problem = with_longer_step(problem, nominal)
        found = Found({"simulation": nominal.states[: len(problem.split.fit.times)]})
        for random_laws in (True, False):
            variants = {n: v for n, v in VARIANTS.items() if v.random_laws is random_laws}
            _fit(problem, nominal, variants, found)
        _write(Path(config.output), problem, found)


def _fit(
    problem: Problem, nominal: NominalRun, variants: Mapping[str, Variant], found: Found
) -> None:
    """Train SHRED once and fit each variant of its assimilation.

    Args:
        problem: settings and recording.
        nominal: simulation from the nominal start.
        variants: that have the same members.
        found: gets the fields and laws.
    """
    from dashred.core.tracking import NullTracker
    from dashred.pipeline.networks.assimilation import assimilate
    from dashred.pipeline.networks.training import train_shred
    from dashred.pipeline.simulation.ensembles import simulate_ensemble

    trained: dict[str, float] = {}
    first = next(iter(variants.values()))
    whole = replace(problem, config=first.of(problem.config))
    ensemble = simulate_ensemble(whole, nominal, trained)
    network = train_shred(whole, ensemble, NullTracker(), trained, "SHRED")
    shred = "shred" if first.random_laws else "shred_without_random_laws"
    for name, variant in variants.items():
        own: dict[str, float] = {}
        fitted = replace(problem, config=variant.of(problem.config))
        result = assimilate(fitted, nominal, network, NullTracker(), own)
        found.states[shred], found.states[name] = result.shred, result.dashred
        found.laws[name] = {
            method: _entries(problem.library, fit) for method, fit in result.proposals.items()
        }
        if result.parameters:
            found.laws[name]["dynamics"] += _changes(problem, result.parameters)
        found.seconds[name] = sum(trained.values()) + sum(own.values())


def _entries(library: Sequence[Term], fit: SparseFit) -> list[TermEntry | ParameterEntry]:
    from dashred.evaluation.baselines.estimate import TermEntry

    return [
        TermEntry(equation=term.equation, term=str(term), coefficient=float(value))
        for term, value in zip(library, fit.coefficients, strict=True)
        if value != 0.0
    ]


def _changes(problem: Problem, parameters: Mapping[str, float]) -> list[ParameterEntry]:
    from dashred.evaluation.baselines.estimate import ParameterEntry

    values = problem.config.system.parameters
    return [
        ParameterEntry(equation=None, parameter=name, to=values[name] + change)
        for name, change in parameters.items()
    ]


def _write(output: Path, problem: Problem, found: Found) -> None:
    from dashred.core.findings.findings import sha256_of, write_json_atomic
    from dashred.pipeline.outputs.field_files import write_estimates
    from dashred.pipeline.run.output_dir import make_output
    from dashred.pipeline.verification.findings_input import build_input

    folder = make_output(str(output))
    count = len(problem.split.fit.times)
    write_estimates(folder / FIELDS, problem.system, problem.times[:count], found.states)
    record: dict[str, Any] = {
        "input": build_input(problem),
        "laws": found.laws,
        "seconds": found.seconds,
        "fields_sha256": sha256_of(folder / FIELDS),
    }
    write_json_atomic(folder / LAWS, record)


if __name__ == "__main__":
    sys.exit(run_entry(main))
