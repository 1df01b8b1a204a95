"""Rates of this machine, measured by small kernels of the libraries that the engine uses."""

from __future__ import annotations

import time
from collections.abc import Callable
from dataclasses import dataclass

import scipy.fft
import torch

# Values of the arrays that are worked on together, as the columns of a Jacobian are.
VALUES = 2**17
# Size of the matrices whose product is timed.
MATRIX = 768
# A kernel runs so often that it takes BATCH seconds, because the clock of the CPU may advance in
# steps of some milliseconds. This is repeated until SECONDS are over; the shortest time counts.
BATCH, SECONDS = 0.02, 0.2


@dataclass(frozen=True)
class Rates:
    """What one core does.

    Attributes:
        transform64: seconds of a real Fourier transform of one field on the grid, in float64.
        transform32: the same in float32.
        bandwidth: bytes per second of ``a = b + s c`` on arrays of the size of a block of columns.
        arithmetic: floating-point operations per second of a product of matrices in float64.
    """

    transform64: float
    transform32: float
    bandwidth: float
    arithmetic: float


def measure_rates(points: int) -> Rates:
    """Measure the rates for a grid of ``points`` × ``points``, with one thread."""
    return Rates(
        _transform(points, torch.float64),
        _transform(points, torch.float32),
        _bandwidth(),
        _arithmetic(),
    )


def _transform(points: int, dtype: torch.dtype) -> float:
    """Return the mean of a transform forward and back, in the fastest way.

    These are the two libraries, and complex transforms of two fields at once.
    """
    count = 2 * max(1, VALUES // points**2 // 2)
    fields = torch.randn((count, points, points), dtype=dtype)
    array, shape = fields.numpy(), (points, points)
    modes = torch.fft.rfftn(fields, dim=(1, 2))
    pairs = torch.complex(fields[::2], fields[1::2])
    forward = min(
        _shortest(lambda: torch.fft.rfftn(fields, dim=(1, 2))),
        _shortest(lambda: scipy.fft.rfftn(array, axes=(1, 2))),
        _shortest(lambda: torch.fft.fftn(pairs, dim=(1, 2))),
    )
    back = min(
        _shortest(lambda: torch.fft.irfftn(modes, s=shape, dim=(1, 2))),
        _shortest(lambda: scipy.fft.irfftn(modes.numpy(), s=shape, axes=(1, 2))),
        _shortest(lambda: torch.fft.ifftn(pairs, dim=(1, 2))),
    )
    return (forward + back) / (2 * count)


def _bandwidth() -> float:
    a, b, c = torch.ones((3, VALUES), dtype=torch.float32)
    seconds = _shortest(lambda: torch.add(b, c, alpha=2.0, out=a))
    return 3 * VALUES * a.element_size() / seconds


def _arithmetic() -> float:
    a, b, out = torch.ones((3, MATRIX, MATRIX), dtype=torch.float64)
    return 2 * MATRIX**3 / _shortest(lambda: torch.mm(a, b, out=out))


def _shortest(run: Callable[[], object]) -> float:
    """Return the shortest time of a run, in CPU seconds, after one that warms up."""
    run()
    count = 1
    while (seconds := _seconds(run, count)) < BATCH:
        count *= 2
    found = [seconds]
    while sum(found) < SECONDS:
        found.append(_seconds(run, count))
    return min(found) / count


def _seconds(run: Callable[[], object], count: int) -> float:
    began = time.process_time()
    for _ in range(count):
        run()
    return time.process_time() - began
