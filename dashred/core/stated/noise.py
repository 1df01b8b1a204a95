"""The noise of a sensor as a text or a number: ``0.1``, ``5%``, ``5% of reading`` or ``counts``."""

from __future__ import annotations

import contextlib
import math
import re
from typing import Any, NamedTuple

from dashred.core.errors import InputError

HINT = (
    "for example 0.1, in the unit of the readings, 5% of their standard deviation, "
    "5% of reading, 0.1 + 5% of reading, or counts"
)
COUNTS = "counts"
OF_READING = re.compile(r"(?:([^+]*)\+)?([^+%]*)%\s*of\s+(?:the\s+)?readings?")
# Counts with a mean near zero have at least this standard deviation.
FEWEST_COUNTS = 0.5


class NoiseLaw(NamedTuple):
    """A noise that depends on the reading y: ``σ² = a² + (b y)² + c |y|``.

    Attributes:
        constant: a, in the unit of the readings.
        relative: b.
        counts: c; 1 for counts, whose variance is their mean.
    """

    constant: float
    relative: float
    counts: float = 0.0


class StatedNoise(NamedTuple):
    """A stated noise, in one of three forms; the others are None.

    Attributes:
        std: σ, in the unit of the readings.
        share: σ as a share of the std of the readings.
        law: σ as a function of the reading.
    """

    std: float | None = None
    share: float | None = None
    law: NoiseLaw | None = None


def parse_noise(given: Any, what: str, where: str) -> StatedNoise:
    """Return a stated noise.

    Args:
        given: a number, or a text such as ``0.1``, ``5%``, ``0.1 + 5% of reading`` or ``counts``.
        what: name of the value, for error messages.
        where: location, for error messages.

    Raises:
        InputError: it is neither a positive number nor a positive share.
    """
    text = given.strip() if isinstance(given, str) else given
    if text == COUNTS:
        return StatedNoise(law=NoiseLaw(FEWEST_COUNTS, 0.0, 1.0))
    of_reading = OF_READING.fullmatch(text) if isinstance(text, str) else None
    if of_reading:
        constant, share = of_reading.groups()
        numbers = (0.0 if constant is None else _positive(constant)), _positive(share) / 100
        if not any(map(math.isnan, numbers)):
            return StatedNoise(law=NoiseLaw(*numbers))
    is_share = isinstance(text, str) and text.endswith("%")
    number = _positive(text.removesuffix("%") if isinstance(text, str) else text)
    if math.isnan(number):
        problem = f"{what} is {given!r}, but must be a positive number or share"
        raise InputError(problem, where=where, hint=HINT)
    return StatedNoise(share=number / 100) if is_share else StatedNoise(std=number)


def _positive(given: Any) -> float:
    """Return a positive number; NaN for anything else."""
    bare = given.strip() if isinstance(given, str) else given
    number = math.nan
    # float() also reads 1_0 and True.
    if isinstance(bare, int | float | str) and not isinstance(bare, bool) and "_" not in str(bare):
        with contextlib.suppress(ValueError):
            number = float(bare)
    return number if 0 < number < math.inf else math.nan
