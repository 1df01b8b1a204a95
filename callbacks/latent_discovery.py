"""Callback that runs latent SINDy during assimilation and logs its coefficients."""

from __future__ import annotations

from typing import Any

import torch
from lightning import Callback, LightningModule, Trainer
from torch import Tensor

from dashred.core.mlflow.metric_names import metric_name
from dashred.core.tracking import Log
from dashred.inference.latent_sindy.latent_sindy import LatentProblem, LatentSindy
from dashred.inference.latent_sindy.sparse_regression import SparseFit
from dashred.models.assimilation import Assimilation


class LatentDiscovery(Callback):
    """Algorithms 1 and 2 by epoch, logged as curves ``alg1/<equation>/<term>``.

    A coefficient is logged from the first epoch in which it is nonzero, so that the store has no
    curves that are always zero.

    Attributes:
        epochs: epochs at which the regressions ran; the last entry is the final state.
        history: algorithm → coefficients ``(term,)`` by epoch.
        final: proposals for the final state, after :meth:`finish`.

    Args:
        problem: what latent SINDy solves.
        child: log of the nested run, which gets all points.
        parent: log of the run of the command, which gets the final ones.
    """

    def __init__(self, problem: LatentProblem, child: Log, parent: Log) -> None:
        self.problem, self.child, self.parent = problem, child, parent
        self.epochs: list[int] = []
        self.history: dict[str, list[list[float]]] = {"alg1": [], "alg2": []}
        self.final: dict[str, SparseFit] = {}
        self._logged: set[str] = set()
        self._sindy: LatentSindy | None = None

    def state_dict(self) -> dict[str, Any]:
        """Return the history and the names of the curves."""
        return {"epochs": self.epochs, "history": self.history, "logged": self._logged}

    def load_state_dict(self, state_dict: dict[str, Any]) -> None:
        """Take them from a fit in other processes."""
        self.epochs, self.history = state_dict["epochs"], state_dict["history"]
        self._logged = state_dict["logged"]

    def on_fit_start(self, trainer: Trainer, pl_module: LightningModule) -> None:
        """Compute the columns for the field before assimilation, in one process only."""
        if trainer.is_global_zero:
            self._sindy = self._on(self._fields(pl_module))

    def on_train_epoch_end(self, trainer: Trainer, pl_module: LightningModule) -> None:
        """Run the regressions and log the coefficients."""
        epoch = trainer.current_epoch + 1
        if trainer.is_global_zero and epoch % self.problem.settings.every == 0:
            assert isinstance(pl_module, Assimilation)
            # Inclusion frequencies are computed for the final proposals only.
            fields = self._fields(pl_module)
            assert self._sindy is not None
            found = self._sindy.propose(pl_module.encoder, fields, bootstraps=0)
            self.child(self._note(found, epoch), epoch)

    def finish(self, module: Assimilation) -> dict[str, SparseFit]:
        """Return the proposals for the final state; its columns are recomputed if it has changed.

        They become the last point of the curves, one epoch after the last regression.
        """
        fields = self._fields(module)
        if self._sindy is None or not torch.equal(fields, self._sindy.fields):
            self._sindy = self._on(fields)
        self.final = self._sindy.propose(module.encoder, fields, self.problem.settings.bootstraps)
        last = (self.epochs[-1] if self.epochs else 0) + 1
        metrics = self._note(self.final, last)
        self.child(metrics, last)
        self.parent(metrics, last)
        return self.final

    def _on(self, fields: Tensor) -> LatentSindy:
        return LatentSindy(self.problem, fields, self.problem.settings.begins)

    def _fields(self, module: LightningModule) -> Tensor:
        assert isinstance(module, Assimilation)
        return module.fields(self.problem.windows)

    def _note(self, found: dict[str, SparseFit], epoch: int) -> dict[str, float]:
        """Add a point to the history and return it as metrics."""
        self.epochs.append(epoch)
        metrics = {}
        for name, fit in found.items():
            self.history[name].append(fit.coefficients.tolist())
            for term, value in zip(self.problem.library, fit.coefficients, strict=True):
                key = metric_name(name, term.equation, str(term))
                if value != 0.0:
                    self._logged.add(key)
                if key in self._logged:
                    metrics[key] = float(value)
        return metrics
