"""Latent SINDy: proposals of Algorithms 1 and 2 from one assimilated state."""

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
    """The input of latent SINDy, without the networks.

    Attributes:
        system: the simulator.
        library: candidate terms.
        scales: coefficients at which each term would be as large as the tendency, ``(term,)``.
        operator: H of SHRED's input sensors.
        times: uniform times within the fit window, ``(time,)``.
        windows: sensor histories of the recording, ``(time, lag, sensor)``.
        settings: config section ``latent_sindy``.
        seed: seed of the bootstrap.
        steps: the steps of the simulator; None integrates the equations of the system.
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
        """Number of earlier samples in a history."""
        return self.windows.shape[1] - 1

    @property
    def strides(self) -> list[int]:
        """The configured step lengths, in samples, that are shorter than the record.

        Raises:
            InputError: no configured step is short enough.
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
        """Return time indices where steps begin, spread over the record, after a full history."""
        last = len(self.times) - 1 - max(self.strides)
        first = min(self.lags, last)
        spread = torch.linspace(first, last, min(count, last - first + 1))
        return spread.round().long().unique()


class LatentSindy:
    """Algorithms 1 and 2 on the current assimilated state.

    The columns ``∂Φ/∂ξ`` cost a simulation for every term, and they change little while the latent
    transform is fitted. They are computed once for the initial field of SHRED, and again for the
    final state. Forecasts and encodings always belong to the current state.
    """

    def __init__(self, problem: LatentProblem, fields: Tensor, count: int) -> None:
        self.problem, self.fields = problem, fields
        self.begins = problem.begins(count)
        self.steps = problem.steps or SimulatorSteps(
            problem.system, problem.library, problem.scales
        )
        self.columns = self.steps.columns(fields, problem.times, self.forecasts(fields))

    def forecasts(self, fields: Tensor) -> list[Step]:
        """Return the simulator's steps from the reconstructed field, one entry for each length."""
        problem = self.problem
        return self.steps.forecasts(fields, problem.times, self.begins, problem.strides)

    def propose(
        self, encoder: AssimilatedEncoder, fields: Tensor, bootstraps: int
    ) -> dict[str, SparseFit]:
        """Return the proposals of both algorithms for the field û, ``(time, field, *grid)``."""
        problem = self.problem
        exact = copy.deepcopy(encoder).cpu().double().requires_grad_(False)
        steps = self.forecasts(fields)
        assimilated = HistoryEncoder(exact, problem.operator, fields, problem.lags)
        plain = HistoryEncoder(exact.shred.encode, problem.operator, fields, problem.lags)
        dt = float(problem.times.diff().median())
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
