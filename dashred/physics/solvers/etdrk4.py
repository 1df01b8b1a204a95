"""Exponential time differencing, fourth order: the linear part of an equation is exact."""

from __future__ import annotations

import math
from collections.abc import Callable
from typing import NamedTuple

import numpy as np
import torch
from torch import Tensor

CONTOUR_POINTS = 32
STEPPERS_KEPT = 8


class Coefficients(NamedTuple):
    """What a step multiplies by: ``full = exp(hL)``, ``half = exp(hL/2)``; q and on multiply N."""

    full: Tensor
    half: Tensor
    q: Tensor
    first: Tensor
    middle: Tensor
    last: Tensor


class ETDRK4:
    """Advance ``û' = Lû + N(û, t)`` with L diagonal in Fourier space.

    Cox & Matthews (J. Comput. Phys. 176, 2002), with the coefficients by contour integrals of
    Kassam & Trefethen (SIAM J. Sci. Comput. 26, 2005) so that small ``hL`` loses no digits.

    Args:
        linear: L, ``(1 | batch, field, *modes)``, per unit time.
        nonlinear: N: ``(û, t)`` → ``(batch, field, *modes)``.
        h: step, in units of time.
    """

    def __init__(
        self, linear: Tensor, nonlinear: Callable[[Tensor, float], Tensor], h: float
    ) -> None:
        self.nonlinear, self.h = nonlinear, h
        found = coefficients(linear, h)
        self.full, self.half, self.q = found.full, found.half, found.q
        self.first, self.middle, self.last = found.first, found.middle, found.last

    def step(self, modes: Tensor, t: float) -> Tensor:
        """Return the modes at ``t + h``."""
        h, nonlinear, q = self.h, self.nonlinear, self.q
        n_u = nonlinear(modes, t)
        linear_half = self.half * modes
        a = torch.addcmul(linear_half, q, n_u)
        n_a = nonlinear(a, t + h / 2)
        b = torch.addcmul(linear_half, q, n_a)
        n_b = nonlinear(b, t + h / 2)
        c = torch.addcmul(self.half * a, q, torch.sub(2 * n_b, n_u))
        n_c = nonlinear(c, t + h)
        found = torch.addcmul(self.full * modes, self.first, n_u)
        found = torch.addcmul(found, self.middle, n_a + n_b)
        return torch.addcmul(found, self.last, n_c)


class StepperCache:
    """The steps of one tendency by their length; the latest few are kept."""

    def __init__(self, linear: Tensor, nonlinear: Callable[[Tensor, float], Tensor]) -> None:
        self.linear, self.nonlinear = linear, nonlinear
        self._kept: dict[float, ETDRK4] = {}

    def __getitem__(self, h: float) -> ETDRK4:
        """Return the step of length ``h``."""
        if h not in self._kept:
            if len(self._kept) == STEPPERS_KEPT:
                del self._kept[next(iter(self._kept))]
            self._kept[h] = ETDRK4(self.linear, self.nonlinear, h)
        return self._kept[h]


def coefficients(linear: Tensor, h: float) -> Coefficients:
    """Return the coefficients of a step of length ``h``, complex, shaped as L is."""
    # Complex even where L is real: a real factor of the modes is converted at every use.
    z = (h * linear).to(torch.complex128)
    return Coefficients(torch.exp(z), torch.exp(z / 2), *_contour_integrals(z, h))


def coefficient_derivatives(linear: Tensor, h: float) -> Coefficients:
    """Return the derivative of every coefficient with respect to L, shaped as L is."""
    z = (h * linear).to(torch.complex128)
    full, half = h * torch.exp(z), h / 2 * torch.exp(z / 2)
    return Coefficients(full, half, *(h * found for found in _contour_integrals(z, h, order=1)))


def _contour_integrals(z: Tensor, h: float, order: int = 0) -> tuple[Tensor, ...]:
    """Return the integrals, each different z's once: of a batch's rows and waves most are alike."""
    if z.requires_grad:
        # A derivative goes through every z of its own.
        return _integrals_around(z, h, order)
    different, places = np.unique(z.cpu().numpy(), return_inverse=True)
    found = _integrals_around(torch.from_numpy(different).to(z.device), h, order)
    at = torch.from_numpy(places).to(z.device).reshape(z.shape)
    return tuple(each[at] for each in found)


def _integrals_around(z: Tensor, h: float, order: int) -> tuple[Tensor, ...]:
    angles = (torch.arange(CONTOUR_POINTS, dtype=torch.float64) + 0.5) / CONTOUR_POINTS
    roots = torch.exp(2j * math.pi * angles).to(z.device)
    half = torch.exp(z / 2)
    sums = [torch.zeros_like(z) for _ in range(4)]
    for root in roots:
        r = z + root
        e_half = half * torch.exp(root / 2)
        e = e_half**2
        # Cauchy: the same integral with one more root below is the derivative.
        weight = root**-order
        sums[0] = sums[0] + weight * (e_half - 1) / r
        sums[1] = sums[1] + weight * (-4 - r + e * (4 - 3 * r + r**2)) / r**3
        sums[2] = sums[2] + weight * (4 + 2 * r + e * (-4 + 2 * r)) / r**3
        sums[3] = sums[3] + weight * (-4 - 3 * r - r**2 + e * (4 - r)) / r**3
    return tuple(h * s / CONTOUR_POINTS for s in sums)
