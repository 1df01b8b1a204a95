"""Where no law explains several episodes, the reader learns that parameters may differ."""

from __future__ import annotations

from typing import Any

import pytest

from dashred.reporting.text.shared_parameters import shared_parameters


def found(verdict: str, episodes: int = 3, **system: Any) -> dict[str, Any]:
    names = [{"name": str(i)} for i in range(episodes)]
    return {
        "verdict": verdict,
        "input": {"config": {"system": system}, "splits": {"episodes": names}},
    }


@pytest.mark.parametrize("verdict", ["outside-library", "not-converged", "unconfirmed"])
def test_it_is_told_where_no_law_explains_the_episodes(verdict: str) -> None:
    [line] = shared_parameters(found(verdict, parameters={"ka": 1.5, "V": 0.5}))
    assert line.startswith("All 3 episodes share ka and V. If one of them may differ")
    assert "per: episode" in line


def test_it_is_not_told_where_it_does_not_apply() -> None:
    given: dict[str, Any] = {"parameters": {"k": 1.0}}
    assert shared_parameters(found("missing-term", **given)) == []
    assert shared_parameters(found("outside-library", episodes=1, **given)) == []
    assert shared_parameters(found("outside-library", parameters={})) == []
    told = found("outside-library", parameter_per={"k": "episode"}, **given)
    assert shared_parameters(told) == []
    told["input"]["splits"] = None
    assert shared_parameters(told) == []
