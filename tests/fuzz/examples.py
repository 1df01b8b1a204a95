"""Number of examples per property: few by default, many in the slow tests."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import pytest
from hypothesis import HealthCheck, Phase, given, settings
from hypothesis.strategies import SearchStrategy

Property = Callable[..., None]

# The machine may be busy.
SECONDS = 20


def fuzzed(few: int, many: int, **strategies: SearchStrategy[Any]) -> Callable[[Property], Any]:
    """Make a test of a property with ``few`` examples, and a slow test with ``many``.

    The slow tests of this folder have more than 200,000 in all. An example that takes longer than
    ``SECONDS`` fails: it is one that hangs.
    """

    def as_test(holds: Property) -> Callable[[int], None]:
        @pytest.mark.parametrize("examples", [few, pytest.param(many, marks=pytest.mark.slow)])
        def test(examples: int) -> None:
            tried = settings(
                max_examples=examples,
                deadline=SECONDS * 1000,
                suppress_health_check=list(HealthCheck),
                phases=(Phase.explicit, Phase.generate, Phase.shrink),
            )
            tried(given(**strategies)(holds))()

        test.__name__, test.__doc__ = holds.__name__, holds.__doc__
        return test

    return as_test
