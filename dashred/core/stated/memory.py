"""Amounts of memory: as a text, ``4 GiB`` or ``500 MB``, and that of this machine."""

from __future__ import annotations

import os
import re
from contextlib import suppress
from pathlib import Path
from typing import Any

from dashred.core.errors import InputError

HINT = "a number with a unit: KiB, MiB, GiB, TiB, kB, MB, GB or TB; for example 4 GiB"
UNITS = {
    **{unit: 1000**power for power, unit in enumerate(("kb", "mb", "gb", "tb"), start=1)},
    **{unit: 1024**power for power, unit in enumerate(("kib", "mib", "gib", "tib"), start=1)},
}
# Files with the limit of a container, of cgroups version 2 and 1. Without a limit they hold a word,
# or a number that is larger than the memory of any machine.
CONTAINER_LIMITS = (
    "/sys/fs/cgroup/memory.max",
    "/sys/fs/cgroup/memory/memory.limit_in_bytes",
)
AMOUNT = re.compile(r"(\d+(?:\.\d+)?)\s*([a-z]+)", re.ASCII | re.IGNORECASE)


def parse_memory(given: Any, where: str) -> int:
    """Return an amount of memory in bytes.

    Args:
        given: a text such as ``4 GiB``.
        where: location, for error messages.

    Raises:
        InputError: it is not a positive number with a unit of memory.
    """
    found = AMOUNT.fullmatch(given.strip()) if isinstance(given, str) else None
    factor = UNITS.get(found[2].lower()) if found else None
    size = int(float(found[1]) * factor) if found and factor else 0
    if size < 1:
        raise InputError(f"{given!r} is not an amount of memory", where=where, hint=HINT)
    return size


def memory_text(size: float) -> str:
    """Return bytes as a text: ``512 MiB``, ``3.2 GiB``."""
    unit, power = ("GiB", 3) if size >= 1024**3 else ("MiB", 2)
    value = size / 1024**power
    return f"{value:.0f} {unit}" if value >= 100 else f"{value:.2g} {unit}"


def machine_memory() -> int:
    """Return the bytes of memory of this machine, or of the container of this process."""
    sizes = [os.sysconf("SC_PAGE_SIZE") * os.sysconf("SC_PHYS_PAGES")]
    for path in CONTAINER_LIMITS:
        with suppress(OSError, ValueError):
            sizes.append(int(Path(path).read_text(encoding="ascii")))
    return min(sizes)
