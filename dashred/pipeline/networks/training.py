"""Train SHRED on an ensemble of simulations and test it on held-out members."""

from __future__ import annotations

import copy
import math
from dataclasses import dataclass

import lightning
import torch
from lightning.pytorch.callbacks import EarlyStopping
from torch import Tensor

from callbacks import BestState, RMSECurves, StageProgress, TimeLimit
from dashred.core.progress import stage
from dashred.core.tracking import RunTracker
from dashred.models.network_size import network_size
from dashred.models.shred import SHRED
from dashred.models.simulation_training import SimulationTraining
from dashred.physics.runs.ensemble import Ensemble
from dashred.physics.runs.stored_states import blocks
from dashred.pipeline.networks.fitting import fitting
from dashred.pipeline.problem import Problem
from datamodules import SimulationDataModule

METRIC = "rmse/field_members"


@dataclass(frozen=True)
class TrainedNetwork:
    """SHRED after training.

    Attributes:
        shred: network on the CPU, with the weights of the best epoch.
        test_rmse: RMSE on the test members in units of the std of each field, by field name; the
            key ``all`` holds the RMSE over all fields.
        scale: std of each field over the ensemble, ``(field,)``.
        curves: metric → (epoch, value).
    """

    shred: SHRED
    test_rmse: dict[str, float]
    scale: Tensor
    curves: dict[str, list[tuple[int, float]]]


@dataclass(frozen=True)
class StoredNetwork:
    """A :class:`TrainedNetwork` as a checkpoint stores it: the weights without the module."""

    weights: dict[str, Tensor]
    grid: tuple[int, ...]
    test_rmse: dict[str, float]
    scale: Tensor
    curves: dict[str, list[tuple[int, float]]]

    @classmethod
    def of(cls, network: TrainedNetwork) -> StoredNetwork:
        """Return the content of a network."""
        shred = network.shred
        weights = dict(shred.state_dict())
        return cls(weights, shred.pod.grid, network.test_rmse, network.scale, network.curves)

    def restored(self) -> TrainedNetwork:
        """Return the network with these weights."""
        shred = SHRED.from_weights(self.weights, self.grid)
        return TrainedNetwork(shred, self.test_rmse, self.scale, self.curves)


def train_shred(
    problem: Problem,
    ensemble: Ensemble,
    run: RunTracker,
    seconds: dict[str, float],
    name: str,
    initial: SHRED | None = None,
) -> TrainedNetwork:
    """Train SHRED on simulated members; the recording is not used.

    Args:
        problem: settings and input sensors.
        ensemble: simulated members.
        run: tracker of the parent run.
        seconds: run time by stage, updated.
        name: name of the network in the log, such as ``SHRED``.
        initial: network whose weights are the initial ones; None draws them at random.
    """
    settings = problem.config.shred
    values = len(problem.system.fields) * math.prod(problem.system.grid.shape)
    size = network_size(values, settings.latent, settings.decoder, settings.epochs)
    fit = problem.split.fit.select(problem.split.inputs)
    # The ensemble may have lost members that diverge.
    members, held_out = len(ensemble.states), problem.config.simulation.held_out
    data = SimulationDataModule(
        ensemble,
        problem.operator(fit),
        problem.noise_of(fit.names),
        settings.lags,
        settings.modes,
        held_out if held_out < members else members // 2,
        settings.batch,
        problem.config.seed,
    )
    lightning.seed_everything(problem.config.seed, verbose=False)
    shred = SHRED(
        data.scaler, data.pod, data.spread, size.latent, settings.layers, size.decoder
    ).float()
    # The trainer moves the network and its basis to the device; the data stay where they are.
    data.pod = copy.deepcopy(data.pod)
    if initial is not None:
        shred.initialise_from(initial)
    steps = size.epochs * settings.steps
    cells = data.pod.modes.shape[1]
    module = SimulationTraining(shred, data.noise.float(), cells, settings.rate, steps)
    slug = name.lower().replace(" ", "_")
    with run.child(slug) as child, stage(f"train {name}", seconds) as report:
        place = fitting(problem.config)
        curves = RMSECurves(place.accept(child.log_metrics), place.accept(run.log_metrics), slug)
        best, limit = BestState(METRIC), TimeLimit(problem.deadline(f"train {name}"))
        place.fit(
            module,
            data,
            [
                curves,
                best,
                limit,
                EarlyStopping(METRIC, patience=settings.patience),
                StageProgress(place.accept(report), METRIC, "field RMSE on held-out members"),
            ],
            max_epochs=size.epochs,
            limit_train_batches=settings.steps,
            precision=problem.config.trainer.precision,
        )
        shred = module.shred.cpu()
        test_rmse = _test(shred, data, problem.system.fields)
        child.log_metrics({f"test/{k}": v for k, v in test_rmse.items()}, best.best_epoch)
        report(1.0, f"field RMSE {test_rmse['all']:.3f} std on unseen members")
    if limit.ended_at is not None:
        problem.budget.leave_out(f"epochs {limit.ended_at + 1} to {size.epochs} of {name}")
    return TrainedNetwork(shred, test_rmse, data.pod.scale, curves.history)


@torch.no_grad()
def _test(shred: SHRED, data: SimulationDataModule, fields: tuple[str, ...]) -> dict[str, float]:
    states, noisy = data.states("test"), data.noisy_windows("test")
    count = math.prod(states.shape[:2])
    # There may be no member to test on.
    squared = torch.full((len(fields),), 0.0 if count else torch.nan, dtype=torch.float64)
    for block in blocks(states):
        truth = block.states.flatten(0, 1)
        windows = noisy[block.members, block.times].flatten(0, 1).float()
        estimates = torch.cat([shred(part).double() for part in windows.split(1024)])
        error = (estimates - truth).transpose(0, 1).flatten(1)
        share = len(truth) / max(1, count)
        squared = squared + share * (error / data.pod.scale[:, None]).square().mean(dim=1)
    by_field = dict(zip(fields, squared.sqrt().tolist(), strict=True))
    return {"all": float(squared.mean().sqrt()), **by_field}
