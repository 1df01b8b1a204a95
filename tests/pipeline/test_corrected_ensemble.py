"""The corrected surrogate: its members are drawn nearer to the start, where need be."""

from __future__ import annotations

from typing import Any

import pytest
import torch

from dashred.core.errors import InputError
from dashred.physics.runs.ensemble import MemberSource
from dashred.pipeline import corrected_ensemble

ANY: Any = None
SOURCE = MemberSource(ANY, torch.zeros(1), ANY, torch.zeros(1), None, ANY)


@pytest.mark.parametrize(("failures", "spreads"), [(0, [0.2]), (2, [0.2, 0.06, 0.02])])
def test_members_that_leave_the_range_are_drawn_nearer(failures: int, spreads: list[float]) -> None:
    asked: list[float] = []

    def draw(source: Any, members: int) -> Any:
        asked.append(source.prior.factor)
        if len(asked) <= failures:
            raise InputError("hardly any simulation stays within bounds")
        return members

    found: Any = corrected_ensemble._members(draw, SOURCE, 0.2, 8)
    assert found == 8
    assert asked == pytest.approx(spreads)


def test_where_none_stays_in_it_the_reason_is_told() -> None:
    def draw(source: MemberSource, members: int) -> Any:
        raise InputError("hardly any simulation stays within bounds")

    with pytest.raises(InputError, match="hardly any"):
        corrected_ensemble._members(draw, SOURCE, 0.2, 8)
