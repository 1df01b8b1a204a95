"""Exponential time differencing, fourth order: the linear part of an equation is exact."""

from __future__ import annotations

import copy
import math
from collections.abc import Callable

import torch
from torch import Tensor

CONTOUR_POINTS = 32
STEPPERS_KEPT = 8


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
        # Complex even where L is real: a real factor of the modes is converted at every use.
        z = (h * linear).to(torch.complex128)
        self.full, self.half = torch.exp(z), torch.exp(z / 2)
        self.q, self.first, self.middle, self.last = _coefficients(z, h)

    def carrying(self, nonlinear: Callable[[Tensor, float], Tensor], like: Tensor) -> ETDRK4:
        """Return the step of another N about the same L, for modes of another kind or place."""
        other = copy.copy(self)
        other.nonlinear = nonlinear
        other.full, other.half = self.full.to(like), self.half.to(like)
        other.q, other.first = self.q.to(like), self.first.to(like)
        other.middle, other.last = self.middle.to(like), self.last.to(like)
        return other

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


class Steppers:
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


def _coefficients(z: Tensor, h: float) -> tuple[Tensor, Tensor, Tensor, Tensor]:
    angles = (torch.arange(CONTOUR_POINTS, dtype=torch.float64) + 0.5) / CONTOUR_POINTS
    roots = torch.exp(2j * math.pi * angles).to(z.device)
    half = torch.exp(z / 2)
    sums = [torch.zeros_like(z) for _ in range(4)]
    for root in roots:
        r = z + root
        e_half = half * torch.exp(root / 2)
        e = e_half**2
        sums[0] = sums[0] + (e_half - 1) / r
        sums[1] = sums[1] + (-4 - r + e * (4 - 3 * r + r**2)) / r**3
        sums[2] = sums[2] + (4 + 2 * r + e * (-4 + 2 * r)) / r**3
        sums[3] = sums[3] + (-4 - 3 * r - r**2 + e * (4 - r)) / r**3
    q, first, middle, last = (h * s / CONTOUR_POINTS for s in sums)
    return q, first, middle, last
