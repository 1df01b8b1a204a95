"""A first state: the longest waves of the domain, drawn through what the sensors read first."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from dashred.pipeline.init.columns import GuessedAxis

# Waves along each axis: of one alone some derivatives would be proportional.
WAVES = 2
# How reluctantly a wave is taken up, times its number: few sensors draw it flat rather than wild.
RELUCTANCE = 0.2


def start_expression(
    axes: Sequence[GuessedAxis], places: NDArray[np.float64], values: NDArray[np.float64]
) -> str:
    """Return an expression in the coordinates: the mean, and two waves along each axis.

    Least squares over the first values, with a small penalty on the waves; the mean alone without
    axes.

    Args:
        axes: taken for rings.
        places: of the sensors, ``(sensor, axis)``.
        values: what they read, ``(sensor,)``.
    """
    waves: list[tuple[str, NDArray[np.float64], float]] = []
    for axis, along in zip(axes, places.T, strict=True):
        for number in range(1, WAVES + 1):
            turns = f"{2 * number}*pi*{axis.name}/{axis.length:g}"
            phase = 2 * np.pi * number * along / axis.length
            waves.append((f"cos({turns})", np.cos(phase), RELUCTANCE * number))
            waves.append((f"sin({turns})", np.sin(phase), RELUCTANCE * number))
    mean = float(values.mean())
    if not waves:
        return f"{mean:.4g}"
    columns = np.stack([np.ones(len(values)), *(wave for _, wave, _ in waves)], axis=1)
    penalty = np.diag([0.0, *(reluctance for *_, reluctance in waves)])
    rest = np.concatenate([values - mean, np.zeros(len(penalty))])
    sizes = np.linalg.lstsq(np.concatenate([columns, penalty]), rest)[0]
    parts = [_signed(size, name) for size, (name, *_) in zip(sizes[1:], waves, strict=True)]
    return f"{mean + sizes[0]:.3g}" + "".join(parts)


def _signed(size: float, wave: str) -> str:
    return f" {'-' if size < 0 else '+'} {abs(size):.3g}*{wave}"
