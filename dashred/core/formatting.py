"""Numbers and terms as they are printed: rounded to what is known of them, with true signs."""

from __future__ import annotations

import math
import re

MINUS = "\N{MINUS SIGN}"
SUPERSCRIPTS = str.maketrans("0123456789", "⁰¹²³⁴⁵⁶⁷⁸⁹")
# Without an uncertainty: as many digits as a reader can use.
DIGITS = 4
LARGEST, SMALLEST = 1e6, 1e-5


def pretty(term: str) -> str:
    """A term as it is printed in books: `u**2*lam` → `u²·lam`."""
    raised = re.sub(r"\*\*(\d+)(?![\d.])", lambda found: found[1].translate(SUPERSCRIPTS), term)
    return raised if "**" in raised else raised.replace("*", "·")


def number(value: float) -> str:
    """A number that nothing more is known of: ``0.035``, ``−1.2e−07``."""
    return f"{value + 0.0:.{DIGITS}g}".replace("-", MINUS)


def rounded(value: float, std: float) -> tuple[str, str]:
    """A value and its standard deviation, to the first digit of the latter: ``0.040``, ``0.003``.

    A leading 1 gets a second digit: of 0.1 to 0.2, one digit says too little.
    """
    if not (math.isfinite(std) and std > 0):
        return number(value), number(std)
    place = math.floor(math.log10(std))
    if std < 2 * 10.0**place:
        place -= 1
    size = max(abs(value), std)
    if size >= LARGEST or size < SMALLEST:
        digits = max(0, math.floor(math.log10(size)) - place)
        return f"{value:.{digits}e}".replace("-", MINUS), f"{std:.0e}".replace("-", MINUS)
    decimals = max(0, -place)
    # The sum turns -0.0 into 0.0.
    texts = (f"{round(x, -place) + 0.0:.{decimals}f}" for x in (value, std))
    first, second = (text.replace("-", MINUS) for text in texts)
    return first, second


def with_error(value: float, std: float) -> str:
    """``−0.0397 ± 0.0003``."""
    return " ± ".join(rounded(value, std))


def probability(p: float) -> str:
    """A small probability: ``3e−05``, ``< 1e−12``, ``0.21``."""
    if p < 1e-12:
        return f"< 1e{MINUS}12"
    return (f"{p:.2f}" if p >= 0.01 else f"{p:.0e}").replace("-", MINUS)


def percent(share: float) -> str:
    """A share: ``39 %``."""
    return f"{share:.0%}".replace("%", " %")
