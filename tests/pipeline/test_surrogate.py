"""The corrected surrogate: its members are drawn nearer to the start, where need be."""

from __future__ import annotations

from typing import Any, cast

import pytest
import torch

from dashred.core.errors import InputError
from dashred.pipeline import surrogate


@pytest.mark.parametrize(("failures", "spreads"), [(0, [0.2]), (2, [0.2, 0.06, 0.02])])
def test_members_that_leave_the_range_are_drawn_nearer(failures: int, spreads: list[float]) -> None:
    asked: list[float] = []

    def draw(_system: Any, _times: Any, starts: Any, *_: Any) -> Any:
        asked.append(starts.factor)
        if len(asked) <= failures:
            raise InputError("hardly any simulation stays within bounds")
        return "members"

    anything: Any = None
    path = torch.zeros(1)
    found: Any = surrogate._members(
        cast(Any, draw), anything, path, anything, 0.2, path, 8, anything, anything
    )
    assert found == "members"
    assert asked == pytest.approx(spreads)


def test_where_none_stays_in_it_the_reason_is_told() -> None:
    def draw(*_: Any) -> Any:
        raise InputError("hardly any simulation stays within bounds")

    anything: Any = None
    path = torch.zeros(1)
    with pytest.raises(InputError, match="hardly any"):
        surrogate._members(
            cast(Any, draw), anything, path, anything, 0.2, path, 8, anything, anything
        )
