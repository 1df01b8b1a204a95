"""Names that are not in use."""

from __future__ import annotations

from dashred.physics.expressions.free_names import free_name, take_name


def test_a_name_is_not_used_twice() -> None:
    assert free_name("z", frozenset({"x"})) == "z"
    assert free_name("z", frozenset({"z", "z_"})) == "z__"


def test_a_name_that_is_taken_is_in_use() -> None:
    taken = {"gain"}
    assert [take_name("gain", taken) for _ in range(2)] == ["gain_", "gain__"]
    assert taken == {"gain", "gain_", "gain__"}
