"""The Jacobian where the state is zero: an oscillator at rest."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import pytest
import torch

from dashred.inference.forward.episodes import EpisodeStarts
from dashred.inference.forward.forward_model import ForwardModel
from dashred.inference.initial_state.start_models import LinearStart
from tests.swing import Swing


@pytest.fixture
def at_rest(tmp_path: Path) -> ForwardModel:
    """A swing with a law, whose start is uncertain by 0.3 and whose most likely start is rest."""
    swing = Swing.declared(tmp_path)
    prior = LinearStart(torch.zeros(2).double(), 0.3 * torch.eye(2).double())
    return replace(swing.forward_model(["x**3", "1"]), start=EpisodeStarts((prior,)))


@pytest.mark.parametrize("force", [0.0, 0.2], ids=["it stays at rest", "a force moves it"])
def test_the_columns_are_the_differences_of_two_runs(at_rest: ForwardModel, force: float) -> None:
    z, law = torch.zeros(2).double(), torch.tensor([0.0, force]).double()
    found = at_rest.linearise(z, law)
    columns = torch.cat([found.by_start, found.by_coefficients], dim=-1)
    moves = 1e-6 * torch.cat([torch.eye(4), -torch.eye(4)]).double()
    ahead, behind = at_rest.readings(z + moves[:, :2], law + moves[:, 2:]).split(4)
    expected = ((ahead - behind) / 2e-6).permute(1, 2, 0)
    torch.testing.assert_close(columns, expected, rtol=1e-5, atol=1e-7)
    torch.testing.assert_close(found.by_start[0], 0.3 * torch.eye(2).double())
