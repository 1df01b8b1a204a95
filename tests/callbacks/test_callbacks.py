"""Callbacks: metrics by epoch, and the restored state."""

from __future__ import annotations

import pickle
from typing import Any

import pytest
import torch
from lightning import LightningModule, Trainer
from torch import nn

from callbacks import BestState, RMSECurves, StageProgress
from datamodules.batches import ordered_batches


class Logged:
    """A run that stores the logged metrics."""

    def __init__(self) -> None:
        self.points: list[tuple[int, dict[str, float]]] = []

    def log_metrics(self, metrics, step):
        """Store the metrics."""
        self.points.append((step, dict(metrics)))

    def curve(self, name: str) -> dict[int, float]:
        """Return the points of one curve, each epoch once."""
        found = [(step, m[name]) for step, m in self.points if name in m]
        assert len({step for step, _ in found}) == len(found)
        return dict(found)


class Scripted(LightningModule):
    """A module with scripted validation errors; its weight counts the epochs."""

    def __init__(self, errors: list[float]) -> None:
        super().__init__()
        self.errors = errors
        self.weight = nn.Parameter(torch.zeros(()))

    def training_step(self, batch: Any, index: int) -> torch.Tensor:
        """Log a loss that depends on the epoch."""
        self.log("loss/train", 10.0 - self.current_epoch, on_step=False, on_epoch=True)
        self.log("other", 1.0, on_step=False, on_epoch=True)
        return -self.weight

    def validation_step(self, batch: Any, index: int) -> None:
        """Log the scripted error of the state."""
        self.log("rmse/x", self.errors[round(float(self.weight.detach()))])

    def configure_optimizers(self) -> torch.optim.Optimizer:
        """Return an optimiser that makes a step of one per epoch."""
        return torch.optim.SGD(self.parameters(), lr=1.0)


def run(errors: list[float], *callbacks: Any) -> Scripted:
    module = Scripted(errors)
    trainer = Trainer(
        accelerator="cpu",
        max_epochs=len(errors) - 1,
        num_sanity_val_steps=-1,
        callbacks=list(callbacks),
        logger=False,
        enable_checkpointing=False,
        enable_progress_bar=False,
        enable_model_summary=False,
    )
    loader = ordered_batches((torch.zeros(2, 1),), 2)
    trainer.fit(module, loader, loader)
    return module


@pytest.mark.parametrize(
    ("errors", "gain", "epoch"),
    [
        ([5.0, 3.0, 1.0, 2.0], 0.0, 2),
        ([1.0, 3.0, 2.0, 2.0], 0.0, 0),  # the state before training is the best
        ([2.0, 2.0, 2.0], 0.0, 0),  # equal is not better
        ([10.0, 9.9, 9.8], 0.05, 0),  # better, but by less than the required gain
        ([10.0, 9.4, 9.0, 9.6], 0.05, 2),
    ],
)
def test_the_best_state_is_restored(errors, gain, epoch):
    best = BestState("rmse/x", gain)
    module = run(errors, best)
    assert best.best_epoch == epoch
    assert best.best == pytest.approx(errors[epoch])
    assert float(module.weight.detach()) == epoch


@pytest.mark.parametrize(
    ("errors", "epoch"),
    [
        ([5.0, 0.5, 0.9, 3.0], 2),  # below the floor the latest counts, not the lowest
        ([0.8, 0.9, 2.0], 1),  # also where the state before training is below it
        ([5.0, 4.0, 3.0], 2),  # above it the lowest counts
        ([5.0, 4.9, 4.8], 0),  # and the required gain
    ],
)
def test_states_at_the_level_of_the_noise_are_equally_good(errors, epoch):
    best = BestState("rmse/x", 0.2, floor=1.0)
    module = run(errors, best)
    assert best.best_epoch == epoch
    assert best.best == max(errors[epoch], 1.0)
    assert float(module.weight.detach()) == epoch


def test_a_state_that_is_not_accepted_is_not_taken():
    def accepts(module: LightningModule) -> bool:
        return float(module.get_parameter("weight").detach()) != 2.0

    best = BestState("rmse/x", accepts=accepts)
    assert float(run([3.0, 2.0, 1.0, 1.5], best).weight.detach()) == best.best_epoch == 3


def test_a_metric_that_is_not_logged_leaves_the_last_state():
    best = BestState("rmse/absent")
    assert float(run([3.0, 2.0, 4.0], best).weight.detach()) == 2.0


def test_curves_are_by_epoch_from_the_state_before_training():
    child, parent = Logged(), Logged()
    curves = RMSECurves(child.log_metrics, parent.log_metrics, "assimilate")
    run([5.0, 3.0, 1.0], curves)
    assert child.curve("rmse/x") == {0: 5.0, 1: 3.0, 2: 1.0}
    assert child.curve("loss/train") == {1: 10.0, 2: 9.0}
    assert child.curve("other") == {}
    assert parent.curve("assimilate/rmse/x") == {0: 5.0, 1: 3.0, 2: 1.0}
    assert curves.history == {
        "rmse/x": [(0, 5.0), (1, 3.0), (2, 1.0)],
        "loss/train": [(1, 10.0), (2, 9.0)],
    }


def test_progress_rises_to_one_and_shows_the_metric():
    told: list[tuple[float, str]] = []
    run(
        [5.0, 3.0, 1.25], StageProgress(lambda done, says: told.append((done, says)), "rmse/x", "x")
    )
    shares = [share for share, _ in told]
    assert shares[-1] == 1.0
    assert all(0 <= share <= 1 for share in shares)
    assert [says for _, says in told if says] == ["x 3.000", "x 1.250"]


def test_callbacks_can_be_sent_to_other_processes() -> None:
    for callback in (BestState("rmse/x"), RMSECurves(print, print, "shred")):
        assert type(pickle.loads(pickle.dumps(callback))) is type(callback)
