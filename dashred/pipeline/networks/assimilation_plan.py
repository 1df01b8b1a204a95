"""What an assimilation fits: the module, its data, and where; with and without dynamics."""

from __future__ import annotations

import copy
from collections.abc import Sequence
from dataclasses import dataclass

import torch
from lightning import LightningDataModule
from torch import Tensor

from dashred.core.budget import Deadline
from dashred.data.observation_operator import ObservationOperator
from dashred.inference.forward.candidates import Candidate
from dashred.inference.latent_sindy.latent_sindy import LatentProblem
from dashred.models.assimilation import Assimilation, AssimilationSensors
from dashred.models.dynamics.basis_error import basis_error
from dashred.models.dynamics.dynamic_assimilation import DynamicAssimilation
from dashred.models.dynamics.network_assimilation import NetworkAssimilation
from dashred.models.dynamics.sampled_dynamics import EpisodeSteps, SampledDynamics
from dashred.models.dynamics.step_residuals import (
    AdvancingResidual,
    Histories,
    SearchResidual,
    StepResidual,
)
from dashred.models.shred import SHRED
from dashred.physics.solvers.sample_step import SampleStep
from dashred.physics.terms.library import resolve
from dashred.pipeline.networks.fitting import FitHere, Fitting, fitting
from dashred.pipeline.networks.training import TrainedNetwork
from dashred.pipeline.problem import Problem
from datamodules import RecordingDataModule, WholeRecordingDataModule

# Epochs with dynamics, each a minimisation, and the least width of the networks that are fitted.
DYNAMIC_EPOCHS, DYNAMIC_WIDTH = 8, 256
# The residual in the fields; the others are those of the algorithms of latent SINDy.
FIELDS = "fields"
# The lowest validation error of a few epochs is hardly chance, and the steps of the simulator
# confirm it: any decrease counts.
DYNAMIC_GAIN = 0.0
# A validation error of this multiple of the noise may be noise alone.
NOISE_MARGIN = 1.2


@dataclass(frozen=True)
class AssimilationPlan:
    """What is fitted, and where.

    Attributes:
        module: the second LightningModule.
        data: its data.
        place: where it is fitted.
        epochs: largest number of epochs.
        gain: relative decrease of the validation error that a change of SHRED needs.
        floor: validation error that noise alone would give; zero if the lowest error is taken.
    """

    module: Assimilation
    data: LightningDataModule
    place: Fitting
    epochs: int
    gain: float
    floor: float = 0.0


def plain_plan(problem: Problem, shred: SHRED, data: RecordingDataModule) -> AssimilationPlan:
    """Return the assimilation of the paper: the sensors alone decide."""
    settings = problem.config.assimilation
    module = Assimilation(
        copy.deepcopy(shred),
        _sensors(problem),
        settings.width,
        settings.penalty,
        rate=settings.rate,
        encoder_rate=settings.encoder_rate,
    )
    return AssimilationPlan(module, data, fitting(problem.config), settings.epochs, settings.gain)


def dynamic_plan(
    problem: Problem,
    latent: LatentProblem,
    parameters: Sequence[Candidate],
    network: TrainedNetwork,
    data: RecordingDataModule,
    simulated: Tensor,
    deadline: Deadline,
) -> AssimilationPlan:
    """Return the assimilation with dynamics. It is fitted in this process, on the CPU.

    Args:
        problem: settings and recording.
        latent: problem of latent SINDy, for the scales of the terms.
        parameters: whose changes are unknowns beside the terms.
        network: trained on the simulation; it is not changed.
        data: the recording.
        simulated: states of the simulation at the samples of the first episode.
        deadline: when the fit ends.
    """
    system, sensors = problem.ensemble_system, _sensors(problem)
    episodes, first = [], 0
    for episode in problem.episodes:
        times = torch.as_tensor(episode.split.fit.times, dtype=torch.float64)
        step = SampleStep(episode.ensemble_system, float(times.diff().max()))
        episodes.append(EpisodeSteps(step, times, first))
        first += len(times)
    dynamics = SampledDynamics(
        episodes,
        [*((term,) for term in resolve(system, latent.library)), *(p.terms for p in parameters)],
        torch.cat([latent.scales, latent.scales.new_tensor([p.scale for p in parameters])]),
        network.shred.pod.scale,
        network.shred.pod.modes.shape[1],
    )
    settings, validation = problem.config.assimilation, problem.split.validation
    kind = DynamicAssimilation if settings.residual == FIELDS else NetworkAssimilation
    accurate = SampleStep(problem.system, float(episodes[0].times.diff().max()))
    unexpressed = basis_error(network.shred.pod, sensors.fit, dynamics, accurate, simulated)
    module = kind(
        copy.deepcopy(network.shred),
        sensors,
        max(settings.width, DYNAMIC_WIDTH),
        settings.penalty,
        windows=data.windows,
        background=torch.tensor([network.test_rmse[name] for name in system.fields]),
        dynamics=dynamics,
        unexpressed=unexpressed,
        adapter=settings.adapter,
        is_over=lambda: deadline.is_over,
    )
    if settings.residual != FIELDS:
        module.residual = _latent_residual(settings.residual, module, data.windows, latent.operator)
    shares = problem.noise_of(validation.names) / torch.from_numpy(validation.trace_scale())
    # The validation part of a single sensor is also an input of SHRED. A state that repeats its
    # noise has the lowest error there, and is not the best one.
    floor = NOISE_MARGIN * float(shares.square().mean().sqrt())
    whole, place = WholeRecordingDataModule(data), FitHere(problem.config, "cpu")
    return AssimilationPlan(module, whole, place, DYNAMIC_EPOCHS, DYNAMIC_GAIN, floor)


def _latent_residual(
    algorithm: str, module: NetworkAssimilation, windows: Tensor, operator: ObservationOperator
) -> StepResidual:
    """Return the residual of Algorithm 1 or 2."""
    histories = Histories(module.shred.encode, windows, operator)
    if algorithm == "alg1":
        return SearchResidual(histories)
    return AdvancingResidual(histories, module.encoder.transform)


def _sensors(problem: Problem) -> AssimilationSensors:
    fit, validation = problem.split.fit, problem.split.validation
    return AssimilationSensors(
        problem.operator(fit),
        problem.operator(validation),
        problem.noise_of(fit.names),
        torch.from_numpy(fit.trace_scale()),
        torch.from_numpy(validation.trace_scale()),
    )
