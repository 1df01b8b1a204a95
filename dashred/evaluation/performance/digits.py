"""Numbers in tables."""

from __future__ import annotations

import numpy as np


def three_digits(value: float) -> str:
    """Format a number with three digits and without an exponent: ``0.0123``, ``51200``."""
    return np.format_float_positional(value, precision=3, unique=False, fractional=False, trim="-")
