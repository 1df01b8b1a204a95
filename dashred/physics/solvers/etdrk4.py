"""Fourth-order exponential time differencing (ETDRK4), exact for the linear part."""

from __future__ import annotations

import math
from collections.abc import Callable
from typing import Any, NamedTuple

import numpy as np
import torch
from torch import Tensor

from dashred.physics.backends.input_signals import Array

# The mean over so many points errs by 1/21!, the term z²⁰ of the exponential series.
CONTOUR_POINTS = 20
CACHE_SIZE = 8
# Values whose contours are integrated together: on the CPU, they fit in the cache.
VALUES_AT_ONCE, VALUES_ON_DEVICE = 2**9, 2**18


class Coefficients(NamedTuple):
    """Coefficients of a step: ``full = exp(hL)``, ``half = exp(hL/2)``; the others multiply N."""

    full: Tensor
    half: Tensor
    q: Tensor
    first: Tensor
    middle: Tensor
    last: Tensor


class ETDRK4:
    """Advance ``û' = Lû + N(û, t)`` with L diagonal in Fourier space.

    The method of Cox & Matthews (J. Comput. Phys. 176, 2002). The coefficients are the contour
    integrals of Kassam & Trefethen (SIAM J. Sci. Comput. 26, 2005), which avoid cancellation for
    small ``hL``.

    Args:
        linear: L, ``(1 | batch, field, *modes)``, per unit time.
        nonlinear: N: ``(û, t)`` → ``(batch, field, *modes)``.
        h: step, in units of time.
    """

    def __init__(
        self, linear: Tensor, nonlinear: Callable[[Tensor, Any], Tensor], h: float
    ) -> None:
        self.nonlinear = nonlinear
        result = coefficients(linear, h)
        self.full, self.half, self.q = result.full, result.half, result.q
        self.first, self.middle, self.last = result.first, result.middle, result.last

    def step(self, modes: Tensor, first: float | Array, last: float | Array) -> Tensor:
        """Return the modes after a step, with the times of its first and last stage.

        These are one time for all states, or the time of each, as N reads it.
        """
        nonlinear, q = self.nonlinear, self.q
        middle = (first + last) / 2
        n_u = nonlinear(modes, first)
        linear_half = self.half * modes
        a = torch.addcmul(linear_half, q, n_u)
        n_a = nonlinear(a, middle)
        b = torch.addcmul(linear_half, q, n_a)
        n_b = nonlinear(b, middle)
        c = torch.addcmul(self.half * a, q, torch.sub(2 * n_b, n_u))
        n_c = nonlinear(c, last)
        result = torch.addcmul(self.full * modes, self.first, n_u)
        result = torch.addcmul(result, self.middle, n_a + n_b)
        return torch.addcmul(result, self.last, n_c)


class StepperCache:
    """Caches the steppers of one equation by step length."""

    def __init__(self, linear: Tensor, nonlinear: Callable[[Tensor, float], Tensor]) -> None:
        self.linear, self.nonlinear = linear, nonlinear
        self._steppers: dict[float, ETDRK4] = {}

    def __getitem__(self, h: float) -> ETDRK4:
        """Return the stepper of step length ``h``."""
        if h not in self._steppers:
            if len(self._steppers) == CACHE_SIZE:
                del self._steppers[next(iter(self._steppers))]
            self._steppers[h] = ETDRK4(self.linear, self.nonlinear, h)
        return self._steppers[h]


def coefficients(linear: Tensor, h: float) -> Coefficients:
    """Return the coefficients of a step of length ``h``, complex, in the shape of L."""
    # Complex even if L is real: a real factor of the modes would be converted at every use.
    z = (h * linear).to(torch.complex128)
    return Coefficients(torch.exp(z), torch.exp(z / 2), *_contour_integrals(z, h))


def coefficient_derivatives(linear: Tensor, h: float) -> Coefficients:
    """Return the derivative of each coefficient with respect to L, in the shape of L."""
    z = (h * linear).to(torch.complex128)
    full, half = h * torch.exp(z), h / 2 * torch.exp(z / 2)
    return Coefficients(full, half, *(h * result for result in _contour_integrals(z, h, order=1)))


def _contour_integrals(z: Tensor, h: float, order: int = 0) -> tuple[Tensor, ...]:
    """Return the contour integrals, computed once for each distinct z."""
    if z.requires_grad or z.device.type != "cpu":
        # The selection of distinct values is not differentiable, and slow on other devices.
        return _integrals_around(z, h, order)
    different, places = np.unique(z.numpy(), return_inverse=True)
    result = _integrals_around(torch.from_numpy(different), h, order)
    at = torch.from_numpy(places).reshape(z.shape)
    return tuple(each[at] for each in result)


def _integrals_around(z: Tensor, h: float, order: int) -> tuple[Tensor, ...]:
    angles = (torch.arange(CONTOUR_POINTS, dtype=torch.float64) + 0.5) / CONTOUR_POINTS
    roots = torch.exp(2j * math.pi * angles).to(z.device)[:, None]
    size = VALUES_AT_ONCE if z.device.type == "cpu" else VALUES_ON_DEVICE
    parts = [_contour_means(part, roots, order) for part in z.flatten().split(size)]
    return tuple(h * torch.cat(each).reshape(z.shape) for each in zip(*parts, strict=True))


def _contour_means(z: Tensor, roots: Tensor, order: int) -> tuple[Tensor, ...]:
    """Return the means over the contours around all z, ``(value,)``; roots are ``(root, 1)``."""
    r = z + roots
    e_half = torch.exp(z / 2) * torch.exp(roots / 2)
    e, r_squared = e_half.square(), r.square()
    # Cauchy's formula: each further factor 1/root gives the next derivative.
    weight = roots**-order / r
    cubic = weight / r_squared
    return (
        (weight * (e_half - 1)).mean(dim=0),
        (cubic * (-4 - r + e * (4 - 3 * r + r_squared))).mean(dim=0),
        (cubic * (4 + 2 * r + e * (-4 + 2 * r))).mean(dim=0),
        (cubic * (-4 - 3 * r - r_squared + e * (4 - r))).mean(dim=0),
    )
