"""The POD of states on disk is that of the states in memory."""

from __future__ import annotations

import pytest
import torch
from torch import Tensor

from dashred.models import pod, stored_pod
from dashred.models.pod import POD
from dashred.models.stored_pod import fit_pod
from dashred.physics.runs import stored_states
from dashred.physics.runs.stored_states import StoredStates
from tests.physics.runs.test_stored_states import TensorReader


def states_of(members: int, samples: int, points: int) -> Tensor:
    """Return states of two fields in different units, whose modes have different energies."""
    generator = torch.Generator().manual_seed(0)
    basis = torch.linalg.qr(torch.randn(2 * points, 2 * points, generator=generator).double()).Q
    sizes = 0.7 ** torch.arange(2 * points).double()
    amplitudes = sizes * torch.randn(members, samples, 2 * points, generator=generator).double()
    fields = (3 + amplitudes @ basis.T).unflatten(-1, (2, points))
    return fields * torch.tensor([1.0, 1e4]).double()[:, None]


@pytest.mark.parametrize(
    ("shape", "largest"),
    [((4, 9, 30), 2048), ((6, 20, 12), 2048), ((6, 20, 30), 40)],
    ids=["few samples", "few cells", "random samples"],
)
def test_the_basis_is_that_in_memory(
    shape: tuple[int, int, int], largest: int, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(pod, "LARGEST_GRAM", largest)
    # Blocks of three states, and groups of seven.
    state = 8 * 2 * shape[2]
    monkeypatch.setattr(stored_states, "BLOCK_BYTES", 3 * state)
    monkeypatch.setattr(stored_pod, "BLOCK_BYTES", 3 * state)
    monkeypatch.setattr(stored_pod, "GROUP_BYTES", 7 * state)
    states = states_of(*shape)
    expected = fit_pod(states, 8)
    found = fit_pod(StoredStates(TensorReader(states), range(len(states))), 8)
    assert torch.equal(fit_pod(states, 8).modes, POD.fit(states.flatten(0, 1), 8).modes)
    assert found.grid == expected.grid
    for name, value in expected.state_dict().items():
        torch.testing.assert_close(found.state_dict()[name], value, rtol=1e-9, atol=1e-9)


def test_a_field_that_is_constant_keeps_its_unit() -> None:
    states = states_of(3, 8, 5)
    states[:, :, 1] = 7.0
    found = fit_pod(StoredStates(TensorReader(states), range(3)), 4)
    assert found.scale[1] == 1.0
    decoded = found.decode(found.encode(states))[:, :, 1]
    torch.testing.assert_close(decoded, torch.full_like(decoded, 7.0))
