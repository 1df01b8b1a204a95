"""Which columns are integrated together."""

from __future__ import annotations

import pytest

from dashred.physics.tangents.spectral_columns.threads import GROUP_POINTS, columns_together


@pytest.mark.parametrize("values", [1, 512, 4096, GROUP_POINTS, 3 * GROUP_POINTS])
@pytest.mark.parametrize("count", [0, 1, 2, 3, 31, 66, 221, 1000])
def test_groups_have_similar_numbers_of_pairs(count: int, values: int) -> None:
    size = columns_together(count, values)
    assert size % 2 == 0 and 0 < size <= 2 * max(1, GROUP_POINTS // values)
    groups = -(-count // size)
    # The last group lacks fewer pairs than there are groups.
    assert groups * size - count <= 2 * max(groups, 1)
