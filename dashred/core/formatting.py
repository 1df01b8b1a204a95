"""Formatting of numbers, terms and sentences for printing."""

from __future__ import annotations

import math
import re
from collections.abc import Sequence

MINUS = "\N{MINUS SIGN}"
SUPERSCRIPTS = str.maketrans("0123456789", "⁰¹²³⁴⁵⁶⁷⁸⁹")
# Significant digits of a number without an uncertainty.
DIGITS = 4
LARGEST, SMALLEST = 1e6, 1e-5
# Half-width of the 95 % interval of a normal distribution, in standard deviations.
Z95 = 1.959964
# The meaning of ± in all texts.
PLUS_MINUS = "± is the half-width of the 95 % interval"


def pretty(term: str) -> str:
    """Return a term in mathematical notation: ``u**2*lam`` → ``u²·lam``."""
    raised = re.sub(r"\*\*(\d+)(?![\d.])", lambda found: found[1].translate(SUPERSCRIPTS), term)
    return raised if "**" in raised else raised.replace("*", "·")


def parenthesize_sum(text: str) -> str:
    """Put a sum in mathematical notation in parentheses, for multiplication by a coefficient."""
    flat = text
    while (rest := re.sub(r"\([^()]*\)", "", flat)) != flat:
        flat = rest
    return f"({text})" if re.search(rf" [+\-{MINUS}] ", flat) else text


def number(value: float) -> str:
    """Format a number without an uncertainty: ``0.035``, ``−1.2e−07``."""
    return f"{value + 0.0:.{DIGITS}g}".replace("-", MINUS)


def rounded(value: float, error: float) -> tuple[str, str]:
    """Round a value and its error to the first digit of the error: ``0.040``, ``0.003``.

    An error with a leading 1 keeps two digits, because one digit would be too coarse.
    """
    if not (math.isfinite(error) and error > 0):
        return number(value), number(error)
    place = math.floor(math.log10(error))
    if error < 2 * 10.0**place:
        place -= 1
    size = max(abs(value), error)
    if size >= LARGEST or size < SMALLEST:
        digits = max(0, math.floor(math.log10(size)) - place)
        return f"{value:.{digits}e}".replace("-", MINUS), f"{error:.0e}".replace("-", MINUS)
    decimals = max(0, -place)
    # The sum turns -0.0 into 0.0.
    texts = (f"{round(x, -place) + 0.0:.{decimals}f}" for x in (value, error))
    first, second = (text.replace("-", MINUS) for text in texts)
    return first, second


def plural(count: int, noun: str) -> str:
    """Return ``1 sensor``, ``2 sensors``."""
    return f"{count} {noun}{'' if count == 1 else 's'}"


def joined(parts: Sequence[str]) -> str:
    """Return parts as a list in a sentence: ``X``, ``X and G``, or ``X, G and W``."""
    *most, last = parts
    return f"{', '.join(most)} and {last}" if most else last


def sentence(text: str) -> str:
    """Return the text with a capital and a full stop."""
    return f"{text[:1].upper()}{text[1:].rstrip('.')}."


def with_error(value: float, std: float) -> str:
    """Format a value with the half-width of its 95 % interval: ``−0.0397 ± 0.0006``."""
    return " ± ".join(rounded(value, Z95 * std))


def percent(share: float) -> str:
    """Format a share as percent: ``39 %``; one digit of a share below one percent, ``0.4 %``."""
    value = 100 * share
    return f"{value:.1g} %" if 0 < abs(value) < 0.95 else f"{value:.0f} %"
