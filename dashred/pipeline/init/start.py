"""Initial state of a first configuration: long waves fitted to the first sensor values."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from dashred.pipeline.init.guessed_system import GuessedAxis

# Waves along each axis. With a single wave some derivatives would be proportional.
WAVES = 2
# Penalty of a wave, times its number, so that a fit to few sensors stays smooth.
PENALTY = 0.2


def start_expression(
    axes: Sequence[GuessedAxis], places: NDArray[np.float64], values: NDArray[np.float64]
) -> str:
    """Return an expression in the coordinates: the mean and two waves along each axis.

    The name ``x_length`` is the length of the axis x. The coefficients are a least-squares fit with
    a small penalty on the waves. Without axes the expression is the mean.

    Args:
        axes: periodic axes.
        places: positions of the sensors, ``(sensor, axis)``.
        values: first values of the sensors, ``(sensor,)``.
    """
    waves: list[tuple[str, NDArray[np.float64], float]] = []
    for axis, along in zip(axes, places.T, strict=True):
        for number in range(1, WAVES + 1):
            # The user will correct the guessed length.
            turns = f"{2 * number}*pi*{axis.name}/{axis.name}_length"
            phase = 2 * np.pi * number * along / axis.length
            waves.append((f"cos({turns})", np.cos(phase), PENALTY * number))
            waves.append((f"sin({turns})", np.sin(phase), PENALTY * number))
    mean = float(values.mean())
    if not waves:
        return f"{mean:.4g}"
    columns = np.stack([np.ones(len(values)), *(wave for _, wave, _ in waves)], axis=1)
    penalties = np.diag([0.0, *(penalty for *_, penalty in waves)])
    target = np.concatenate([values - mean, np.zeros(len(penalties))])
    sizes = np.linalg.lstsq(np.concatenate([columns, penalties]), target)[0]
    parts = [_signed(size, name) for size, (name, *_) in zip(sizes[1:], waves, strict=True)]
    return f"{mean + sizes[0]:.3g}" + "".join(parts)


def _signed(size: float, wave: str) -> str:
    return f" {'-' if size < 0 else '+'} {abs(size):.3g}*{wave}"
