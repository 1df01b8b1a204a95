"""Sets of terms beside a hidden state, on a linear problem."""

from __future__ import annotations

import torch

from dashred.inference.fit.selection.subset_search import ProfiledProblem
from dashred.inference.hidden_states.screening import _best_sets


def test_a_short_library_is_exhausted_before_the_largest_law() -> None:
    """One term, the gain of a hidden state and its start make up all sets."""
    generator = torch.Generator().manual_seed(0)
    columns = torch.randn(40, 3, generator=generator, dtype=torch.float64)
    goal = columns @ torch.tensor([1.0, 0.5, 0.2], dtype=torch.float64)
    problem = ProfiledProblem(
        columns.T @ columns,
        columns.T @ goal,
        float(goal @ goal),
        torch.zeros(3, dtype=torch.float64),
    )
    found = dict(_best_sets(problem, 1, 2, [False, True, True]))
    assert set(found) == {(1,), (1, 2), (0, 1), (0, 1, 2)}
    assert min(found, key=found.__getitem__) == (0, 1, 2)
