"""Callback that chooses the law of an assimilation with dynamics at the end of each epoch."""

from __future__ import annotations

import numpy as np
import torch
from lightning import Callback, LightningModule, Trainer
from torch import Tensor

from callbacks.simplest_law import simplest_law
from dashred.core.mlflow.metric_names import metric_name
from dashred.core.tracking import Log
from dashred.inference.latent_sindy.blocks import Blocks
from dashred.inference.latent_sindy.field_regression import field_regression
from dashred.inference.latent_sindy.latent_sindy import LatentProblem
from dashred.inference.latent_sindy.sparse_regression import SparseFit, sparse_fit
from dashred.inference.latent_sindy.step_sensitivities import SimulatorSteps
from dashred.models.dynamics.dynamic_assimilation import DynamicAssimilation
from dashred.models.dynamics.state_fit import Fitted

NAME = "dynamics"
# Columns that a regression may simulate, in values of the state.
MOST_VALUES = 2**19


class LawRegression(Callback):
    """Sparse regression of the simulator's errors along the assimilated field.

    It sets the support of the law that the network learns, and the initial values of its
    coefficients. A term that the next regression does not choose is left out again. While the steps
    of the field do not fit the law that it has, the law is kept. If they fit the smallest q and the
    terms stay the same, the fit has come to its end.

    Attributes:
        history: coefficients ``(term,)`` by epoch; those of the epochs that latent SINDy logs.

    Args:
        problem: what latent SINDy solves.
        child: log of the nested run, which gets all points.
        parent: log of the run of the command, which gets the final ones.
    """

    def __init__(self, problem: LatentProblem, child: Log, parent: Log) -> None:
        self.problem, self.child, self.parent = problem, child, parent
        self.history: list[list[float]] = []
        self._steps = SimulatorSteps(problem.system, problem.library, problem.scales)
        self._last: tuple[Tensor, Blocks] | None = None

    def on_train_epoch_end(self, trainer: Trainer, pl_module: LightningModule) -> None:
        """Choose the law of the next epoch."""
        assert isinstance(pl_module, DynamicAssimilation)
        found = self._regress(pl_module, bootstraps=0)
        # The errors of a field that is still far from its law would be told as more terms.
        if pl_module.steps_fit or not pl_module.dynamics.support.any():
            before = pl_module.dynamics.support.clone()
            pl_module.dynamics.set_law(torch.from_numpy(found.coefficients))
            if pl_module.is_settled and torch.equal(pl_module.dynamics.support, before):
                trainer.should_stop = True
        epoch = trainer.current_epoch + 1
        if epoch % self.problem.settings.every == 0:
            self.child(self._note(found), epoch)

    def finish(
        self, module: DynamicAssimilation, batch: tuple[Tensor, Tensor], epoch: int
    ) -> tuple[SparseFit, Fitted | None]:
        """Return the final proposal, and the minimum with its law if the steps fit.

        Args:
            module: the assimilation, with its best state.
            batch: windows and fitted values of all samples.
            epoch: number of the last point of the curves.
        """
        found = self._regress(module, self.problem.settings.bootstraps)
        law, fitted = simplest_law(module, batch, found.coefficients)
        final = found.with_law(law, self._blocks(module))
        metrics = self._note(final)
        self.child(metrics, epoch)
        self.parent(metrics, epoch)
        return final, fitted

    def _regress(self, module: DynamicAssimilation, bootstraps: int) -> SparseFit:
        rng = np.random.default_rng([self.problem.seed, 0xD1A])
        return sparse_fit(self._blocks(module), self.problem.settings.threshold, bootstraps, rng)

    def _blocks(self, module: DynamicAssimilation) -> Blocks:
        """Return the regression; the last epoch is often the best, and is not simulated again."""
        problem, fields = self.problem, module.fields(self.problem.windows)
        if self._last is None or not torch.equal(fields, self._last[0]):
            affordable = MOST_VALUES // (fields[0].numel() * len(problem.library))
            begins = problem.begins(max(problem.settings.begins, affordable))
            steps = self._steps.forecasts(fields, problem.times, begins, problem.strides)
            columns = self._steps.columns(fields, problem.times, steps)
            pod, modes = module.shred.pod, problem.windows.shape[-1]
            found = field_regression(pod, modes, fields, steps, columns, problem.scales)
            self._last = fields, found
        return self._last[1]

    def _note(self, found: SparseFit) -> dict[str, float]:
        """Add a point to the history and return it as metrics."""
        self.history.append(found.coefficients.tolist())
        return {
            metric_name(NAME, term.equation, str(term)): float(value)
            for term, value in zip(self.problem.library, found.coefficients, strict=True)
            if value != 0.0
        }
