"""Callback that chooses the law of an assimilation with dynamics at the end of each epoch."""

from __future__ import annotations

from collections.abc import Sequence
from contextlib import suppress
from typing import NamedTuple

import numpy as np
from lightning import Callback, LightningModule, Trainer

from callbacks.simplest_law import best_law, simplest_law
from dashred.core.budget import OutOfTimeError
from dashred.core.mlflow.metric_names import metric_name
from dashred.core.tracking import Log
from dashred.inference.latent_sindy.blocks import Array, Blocks
from dashred.inference.latent_sindy.field_regression import field_regression
from dashred.inference.latent_sindy.latent_sindy import LatentProblem
from dashred.inference.latent_sindy.sparse_regression import SparseFit, sparse_fit
from dashred.inference.latent_sindy.step_sensitivities import SimulatorSteps
from dashred.models.dynamics.dynamic_assimilation import DynamicAssimilation
from dashred.models.dynamics.state_fit import Minimum

NAME = "dynamics"
# Columns that a regression may simulate, in values of the state.
MOST_VALUES = 2**19


class Proposal(NamedTuple):
    """What an assimilation with dynamics proposes.

    Attributes:
        fit: terms of the library.
        parameters: coefficients ξ of the tangents ∂N/∂p of parameters, by name; only those that are
            not zero.
        minimum: with this law; None if it does not explain the readings.
    """

    fit: SparseFit
    parameters: dict[str, float]
    minimum: Minimum | None


class LawSelection(Callback):
    """Choose the terms of the law that an assimilation learns.

    About the minimum of an epoch, the states are eliminated from the linearised loss, and the set
    of terms with the lowest score is the law of the next epoch (:mod:`.simplest_law`). A term that
    the next search does not choose is left out again.

    Attributes:
        history: coefficients of the terms of the library, ``(term,)``, by epoch; those of the
            epochs that latent SINDy logs.
        parameter_history: coefficients of the tangents of parameters, by name and epoch.

    Args:
        problem: what latent SINDy solves.
        parameters: names of parameters, whose changes follow the coefficients of the library.
        child: log of the nested run, which gets all points.
        parent: log of the run of the command, which gets the final ones.
    """

    def __init__(
        self, problem: LatentProblem, parameters: Sequence[str], child: Log, parent: Log
    ) -> None:
        self.problem, self.parameters = problem, tuple(parameters)
        self.child, self.parent = child, parent
        self.history: list[list[float]] = []
        self.parameter_history: dict[str, list[float]] = {name: [] for name in parameters}

    def on_train_epoch_end(self, trainer: Trainer, pl_module: LightningModule) -> None:
        """Choose the law of the next epoch."""
        assert isinstance(pl_module, DynamicAssimilation)
        dynamics = pl_module.dynamics
        if pl_module.minimum is not None:
            with suppress(OutOfTimeError):
                dynamics.set_law(best_law(pl_module.minimum))
        epoch = trainer.current_epoch + 1
        if epoch % self.problem.settings.every == 0:
            self.child(self._note(dynamics.coefficients.detach().numpy()), epoch)

    def finish(self, module: DynamicAssimilation, epoch: int) -> Proposal:
        """Return the final proposal, with the minimum with its law if it explains the readings.

        Where no law does, that of the best epoch is proposed as it is. The shares and inclusions of
        the terms are those of a sparse regression along the field.

        Args:
            module: the assimilation.
            epoch: number of the last point of the curves.
        """
        law, minimum = module.dynamics.coefficients.detach(), module.minimum
        if minimum is not None:
            minimum = simplest_law(minimum)
            module.dynamics.set_law(law)
            if minimum.fitted.parts["step_error"] > 1.0 or not minimum.is_consistent:
                minimum = None
            else:
                law = minimum.fitted.coefficients
        blocks, settings = self._blocks(module), self.problem.settings
        rng = np.random.default_rng([self.problem.seed, 0xD1A])
        found = sparse_fit(blocks, settings.threshold, settings.bootstraps, rng)
        metrics = self._note(law.numpy())
        self.child(metrics, epoch)
        self.parent(metrics, epoch)
        terms = len(self.problem.library)
        changes = zip(self.parameters, law[terms:].tolist(), strict=True)
        proposed = found.with_law(law[:terms].numpy(), blocks)
        return Proposal(proposed, {name: value for name, value in changes if value}, minimum)

    def _blocks(self, module: DynamicAssimilation) -> Blocks:
        """Return the regression of the simulator's errors along the field on all terms."""
        problem, fields = self.problem, module.fields(self.problem.windows)
        affordable = MOST_VALUES // (fields[0].numel() * len(problem.library))
        begins = problem.begins(max(problem.settings.begins, affordable))
        simulator = SimulatorSteps(problem.system, problem.library, problem.scales)
        steps = simulator.forecasts(fields, problem.times, begins, problem.strides)
        columns = simulator.columns(fields, problem.times, steps)
        pod, modes = module.shred.pod, problem.windows.shape[-1]
        return field_regression(pod, modes, fields, steps, columns, problem.scales)

    def _note(self, law: Array) -> dict[str, float]:
        """Add a point to the history and return it as metrics."""
        terms = len(self.problem.library)
        self.history.append(law[:terms].tolist())
        for name, value in zip(self.parameters, law[terms:].tolist(), strict=True):
            self.parameter_history[name].append(value)
        names = [
            *(metric_name(NAME, term.equation, str(term)) for term in self.problem.library),
            *(metric_name(NAME, "parameter", name) for name in self.parameters),
        ]
        return {name: float(value) for name, value in zip(names, law, strict=True) if value != 0.0}
