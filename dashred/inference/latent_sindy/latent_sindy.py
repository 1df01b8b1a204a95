"""Latent SINDy: from one assimilated state to the proposals of Algorithms 1 and 2."""

from __future__ import annotations

import copy
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
import torch
from torch import Tensor

from dashred import config as schema
from dashred.core.errors import InputError
from dashred.data.observation_operator import ObservationOperator
from dashred.inference.latent_sindy.algorithms import compressed_advancing, compressed_search
from dashred.inference.latent_sindy.sensor_encoding import HistoryEncoder
from dashred.inference.latent_sindy.sparse_regression import SparseFit, sparse_fit
from dashred.inference.latent_sindy.step_sensitivities import SimulatorSteps, Step, Steps
from dashred.models.assimilation import AssimilatedEncoder
from dashred.physics.system import System, Term


@dataclass(frozen=True)
class LatentProblem:
    """What latent SINDy needs beside the networks.

    Attributes:
        system: the simulator.
        library: candidate terms.
        scales: coefficient at which each term would equal the whole tendency, ``(term,)``.
        operator: H of SHRED's input sensors.
        times: clock, ``(time,)``, uniform, within the fit window.
        windows: the recording's own histories, ``(time, lag, sensor)``.
        settings: config section ``latent_sindy``.
        seed: of the bootstrap.
        steps: what a step of the simulator does; None runs the system's own equations.
    """

    system: System
    library: Sequence[Term]
    scales: Tensor
    operator: ObservationOperator
    times: Tensor
    windows: Tensor
    settings: schema.LatentSindy
    seed: int
    steps: Steps | None = None

    @property
    def lags(self) -> int:
        """Samples of history behind the present one."""
        return self.windows.shape[1] - 1

    @property
    def strides(self) -> list[int]:
        """Step lengths, in samples, that fit into the record.

        Raises:
            InputError: none of those asked for does.
        """
        fitting = [n for n in self.settings.steps if n < len(self.times) - 1]
        if not fitting:
            raise InputError(
                f"the fit window has {len(self.times)} samples, shorter than every step",
                where=self.system.where("latent_sindy.steps"),
                hint="give a step of one sample",
            )
        return fitting

    def begins(self, count: int) -> Tensor:
        """Return time indices to step from: spread over the record, full histories first."""
        last = len(self.times) - 1 - max(self.strides)
        first = min(self.lags, last)
        spread = torch.linspace(first, last, min(count, last - first + 1))
        return spread.round().long().unique()


class LatentSindy:
    """Algorithms 1 and 2 on the current assimilated state.

    The columns ``∂Φ/∂ξ`` cost a simulation for every term, and move little while the latent
    transform is fitted: they are computed once, on the field SHRED starts from, and once more
    when the state is final. Forecasts and encodings are always those of the current state.
    """

    def __init__(self, problem: LatentProblem, fields: Tensor, count: int) -> None:
        self.problem, self.fields = problem, fields
        self.begins = problem.begins(count)
        self.steps = problem.steps or SimulatorSteps(
            problem.system, problem.library, problem.scales
        )
        self.columns = self.steps.columns(fields, problem.times, self.forecasts(fields))

    def forecasts(self, fields: Tensor) -> list[Step]:
        """Return the simulator's steps from the reconstructed field, one entry a length."""
        problem = self.problem
        return self.steps.forecasts(fields, problem.times, self.begins, problem.strides)

    def propose(
        self, encoder: AssimilatedEncoder, fields: Tensor, bootstraps: int
    ) -> dict[str, SparseFit]:
        """Return the proposals of both algorithms for û = ``fields``, ``(time, field, *grid)``."""
        problem = self.problem
        exact = copy.deepcopy(encoder).cpu().double().requires_grad_(False)
        steps = self.forecasts(fields)
        assimilated = HistoryEncoder(exact, problem.operator, fields, problem.lags)
        plain = HistoryEncoder(exact.shred.encode, problem.operator, fields, problem.lags)
        dt = float(problem.times[1] - problem.times[0])
        search = compressed_search(plain, fields, steps, self.columns, problem.scales)
        advancing = compressed_advancing(
            assimilated,
            exact(problem.windows.double()),
            problem.system,
            problem.library,
            fields,
            steps,
            torch.tensor([dt * stride for stride in problem.strides]),
            problem.scales,
        )
        settings, rng = problem.settings, np.random.default_rng([problem.seed, 0x51D7])
        return {
            name: sparse_fit(blocks, settings.threshold, bootstraps, rng)
            for name, blocks in {"alg1": search, "alg2": advancing}.items()
        }
