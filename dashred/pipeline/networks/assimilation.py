"""Assimilation: fit the latent transform to the recording, with latent SINDy at every epoch."""

from __future__ import annotations

import copy
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace

import lightning
from lightning.pytorch.callbacks import EarlyStopping
from torch import Tensor

from callbacks import (
    BestState,
    LatentDiscovery,
    LatentLaw,
    LawSelection,
    RMSECurves,
    StageProgress,
    TimeLimit,
)
from callbacks.law_selection import NAME
from dashred.core.progress import stage
from dashred.core.tracking import RunTracker
from dashred.inference.forward.candidates import Candidate
from dashred.inference.latent_sindy.latent_sindy import LatentProblem
from dashred.inference.latent_sindy.sparse_regression import SparseFit
from dashred.inference.results.parameter_change import parameter_change
from dashred.models.assimilation import AssimilatedEncoder, Assimilation
from dashred.models.dynamics.dynamic_assimilation import DynamicAssimilation
from dashred.models.dynamics.state_fit import Minimum
from dashred.models.shred import reconstruct
from dashred.physics.runs.ensemble import term_scales
from dashred.pipeline.networks.assimilation_plan import FIELDS, dynamic_plan, plain_plan
from dashred.pipeline.networks.free_parameters import free_parameters
from dashred.pipeline.networks.training import TrainedNetwork
from dashred.pipeline.problem import Problem
from dashred.pipeline.simulation.nominal_run import NominalRun
from dashred.pipeline.simulation.program_cost import follows_segments
from datamodules import EpisodesDataModule, RecordingDataModule

METRIC = "rmse/sensors_validate"
# With dynamics, the validation error of the final state over the lowest one of an epoch, at most.
FINAL_MARGIN = 1.5


@dataclass(frozen=True)
class AssimilationResult:
    """SHRED and DA-SHRED on the recording.

    Attributes:
        shred: field that SHRED reconstructs over the fit window, ``(time, field, *grid)``.
        dashred: field that SHRED reconstructs with the latent transform, same shape.
        best_epoch: epoch with the lowest validation error; 0 keeps SHRED unchanged.
        proposals: algorithm → terms that Algorithms 1 and 2 propose for the final network.
        epochs: epochs at which the regressions ran.
        coefficients: algorithm → coefficients by epoch, ``(epoch, term)``.
        curves: metric → (epoch, value).
        others: ``(shred, dashred)`` of the other fitted episodes.
        parameters: changes of parameters that the assimilation with dynamics proposes, by name.
        tangents: coefficients of the tangents ∂N/∂p of all parameters, by name and epoch.
    """

    shred: Tensor
    dashred: Tensor
    best_epoch: int
    proposals: dict[str, SparseFit]
    epochs: list[int]
    coefficients: dict[str, list[list[float]]]
    curves: dict[str, list[tuple[int, float]]]
    others: tuple[tuple[Tensor, Tensor], ...] = ()
    parameters: Mapping[str, float] = field(default_factory=dict)
    tangents: Mapping[str, list[float]] = field(default_factory=dict)


def sensor_data(problem: Problem) -> RecordingDataModule:
    """Return the training data of the assimilation: the recording, episode by episode."""
    every = tuple(episode.split.fit for episode in problem.episodes)
    parts = [
        RecordingDataModule(
            episode.split.fit,
            episode.split.validation,
            episode.split.inputs,
            episode.config.shred.lags,
            episode.config.assimilation.batch,
            episode.config.seed,
            every,
        )
        for episode in problem.episodes
    ]
    return parts[0] if len(parts) == 1 else EpisodesDataModule(parts)


def assimilate(
    problem: Problem,
    nominal: NominalRun,
    network: TrainedNetwork,
    run: RunTracker,
    seconds: dict[str, float],
) -> AssimilationResult:
    """Fit the latent transform T to the fit sensors and propose terms at every epoch.

    Training stops when the error at the validation sensors no longer decreases.

    Args:
        problem: settings and recording.
        nominal: simulation that gives the scales of the terms.
        network: trained on the simulation; it is not changed.
        run: tracker of the parent run.
        seconds: run time by stage, updated.
    """
    latent, simulated = _latent_problem(problem, nominal), nominal.references[0]
    # The law of a latent residual has no changes of parameters.
    settings = problem.config.assimilation
    by_fields = settings.dynamics and settings.residual == FIELDS
    parameters = free_parameters(problem, nominal) if by_fields else []
    return fit_transform(problem, latent, network, run, seconds, simulated, parameters)[0]


def fit_transform(
    problem: Problem,
    latent: LatentProblem,
    network: TrainedNetwork,
    run: RunTracker,
    seconds: dict[str, float],
    simulated: Tensor | None = None,
    parameters: Sequence[Candidate] = (),
) -> tuple[AssimilationResult, AssimilatedEncoder]:
    """Fit the latent transform with a given problem of latent SINDy.

    Args:
        problem: settings and recording.
        latent: problem that latent SINDy solves at every epoch.
        network: trained on the simulation; it is not changed.
        run: tracker of the parent run.
        seconds: run time by stage, updated.
        simulated: states of the simulation, ``(time, field, *grid)``; dynamics need them.
        parameters: whose changes are unknowns of an assimilation with dynamics.

    Returns:
        The result, and the encoder G_R: SHRED followed by the latent transform.
    """
    settings, deadline = problem.config.assimilation, problem.deadline("assimilate")
    data = sensor_data(problem)
    lightning.seed_everything(problem.config.seed + 1, verbose=False)
    if settings.dynamics:
        assert simulated is not None
        simulated = simulated[: len(latent.times)]
        plan = dynamic_plan(problem, latent, parameters, network, data, simulated, deadline)
    else:
        plan = plain_plan(problem, network.shred, data)
    module, place = plan.module, plan.place
    before = reconstruct(network.shred.encode, network.shred, data.windows)
    with run.child("assimilate") as child, stage("assimilate, latent SINDy", seconds) as report:
        child.log_terms([str(term) for term in problem.library])
        logs = place.accept(child.log_metrics), place.accept(run.log_metrics)
        curves, discovery = RMSECurves(*logs, "assimilate"), LatentDiscovery(latent, *logs)
        best, limit = BestState(METRIC, plan.gain, plan.floor, _is_consistent), TimeLimit(deadline)
        # Latent SINDy simulates in every epoch.
        proposes = not follows_segments(problem)
        stepped = replace(latent, system=problem.ensemble_system)
        by_fields = settings.dynamics and settings.residual == FIELDS
        names = [parameter.name for parameter in parameters]
        law = LawSelection(stepped, names, *logs) if by_fields else None
        in_latent_space = settings.dynamics and not by_fields and proposes
        place.fit(
            module,
            plan.data,
            [
                curves,
                best,
                limit,
                *([discovery] if proposes else []),
                *([] if law is None else [law]),
                *([LatentLaw(discovery, settings.residual)] if in_latent_space else []),
                EarlyStopping(METRIC, patience=settings.patience),
                StageProgress(place.accept(report), METRIC, "RMSE on validation sensors"),
            ],
            max_epochs=plan.epochs,
        )
        module, best_epoch, error = module.cpu(), best.best_epoch, best.best
        proposals = discovery.finish(module) if proposes else {}
        coefficients, changed = dict(discovery.history), dict[str, float]()
        if law is not None:
            assert isinstance(module, DynamicAssimilation)
            last = discovery.epochs[-1]
            proposals[NAME], changes, minimum = law.finish(module, last)
            changed = {p: parameter_change(problem.system, p, xi) for p, xi in changes.items()}
            coefficients[NAME] = law.history
            final = None if minimum is None else _take_final(module, minimum, data, best_epoch)
            if final is not None:
                best_epoch, error = last, final
        report(1.0, f"best after {best_epoch} epochs, RMSE {error:.3f} on validation")
    if not proposes:
        problem.budget.leave_out("latent SINDy")
    if limit.ended_at is not None:
        left_out = f"epochs {limit.ended_at + 1} to {plan.epochs} of the assimilation"
        problem.budget.leave_out(left_out)
    after = reconstruct(module.encoder, module.shred, data.windows)
    counts = [len(episode.split.fit.times) for episode in problem.episodes]
    (first, assimilated), *others = zip(before.split(counts), after.split(counts), strict=True)
    result = AssimilationResult(
        first,
        assimilated,
        best_epoch,
        proposals,
        discovery.epochs,
        coefficients,
        curves.history,
        tuple(others),
        changed,
        {} if law is None else law.parameter_history,
    )
    return result, module.encoder


def _is_consistent(module: lightning.LightningModule) -> bool:
    assert isinstance(module, Assimilation)
    return module.is_consistent


def _take_final(
    module: DynamicAssimilation, minimum: Minimum, data: RecordingDataModule, best_epoch: int
) -> float | None:
    """Take the minimum with the final law, unless the validation readings contradict it.

    Returns its validation error; None if it was not taken.

    The lowest error of some epochs is low by chance, too, so that the final one may be a little
    higher. Where no epoch was better than SHRED, it has to be lower.
    """
    limit = module.validation_error(data.windows, data.validated)
    if best_epoch > 0:
        limit *= FINAL_MARGIN
    state = copy.deepcopy(module.state_dict())
    module.take(data.windows, minimum)
    error = module.validation_error(data.windows, data.validated)
    if error < limit:
        return error
    module.load_state_dict(state)
    return None


def _latent_problem(problem: Problem, nominal: NominalRun) -> LatentProblem:
    # A step must not lead from one episode into another. The first episode is the longest.
    fit = problem.split.fit
    count = len(fit.times)
    times = problem.times[:count]
    return LatentProblem(
        system=problem.system,
        library=problem.library,
        scales=term_scales(problem.system, problem.library, nominal.references[0][:count], times),
        operator=problem.operator(fit.select(problem.split.inputs)),
        times=times,
        windows=sensor_data(problem).windows[:count],
        settings=problem.config.latent_sindy,
        seed=problem.config.seed,
    )
