"""Amounts of memory as texts."""

from __future__ import annotations

import os

import pytest

from dashred.core.errors import InputError
from dashred.core.stated.memory import machine_memory, memory_text, parse_memory


@pytest.mark.parametrize(
    ("text", "size"),
    [
        ("4 GiB", 4 * 2**30),
        ("4GiB", 4 * 2**30),
        ("0.5 TiB", 2**39),
        ("500 MB", 500_000_000),
        ("64 kB", 64_000),
        ("2 gib", 2**31),
    ],
)
def test_units_are_of_powers_of_1024_or_1000(text: str, size: int) -> None:
    assert parse_memory(text, "here") == size


@pytest.mark.parametrize("given", ["4", "4 m", "GiB", "-4 GiB", "0 GiB", "4 GiB/s", "1e9 B", "", 4])
def test_what_is_no_amount_is_refused(given: object) -> None:
    with pytest.raises(InputError, match="is not an amount of memory") as error:
        parse_memory(given, "here")
    assert error.value.where == "here" and "4 GiB" in str(error.value.hint)


def test_texts_have_two_digits_or_are_whole() -> None:
    assert memory_text(3.25 * 2**30) == "3.2 GiB"
    assert memory_text(512 * 2**20) == "512 MiB"
    assert memory_text(2**20) == "1 MiB"


def test_the_memory_of_a_machine_is_at_most_the_physical_one() -> None:
    physical = os.sysconf("SC_PAGE_SIZE") * os.sysconf("SC_PHYS_PAGES")
    assert 0 < machine_memory() <= physical
