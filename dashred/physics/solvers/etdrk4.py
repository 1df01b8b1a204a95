"""Fourth-order exponential time differencing (ETDRK4), exact for the linear part."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any, NamedTuple

import torch
from torch import Tensor

from dashred.physics.backends.input_signals import Array
from dashred.physics.solvers.phi_functions import phi_functions

CACHE_SIZE = 8
# Values whose coefficients are computed together: on the CPU, they fit in the cache.
VALUES_AT_ONCE, VALUES_ON_DEVICE = 2**13, 2**18


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

    The method of Cox & Matthews (J. Comput. Phys. 176, 2002). Their coefficients are sums of φ
    functions (:mod:`.phi_functions`), which do not cancel for small ``hL``.

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
    return _in_parts(_coefficients, linear, h)


def coefficient_derivatives(linear: Tensor, h: float) -> Coefficients:
    """Return the derivative of each coefficient with respect to L, in the shape of L."""
    return _in_parts(_derivatives, linear, h)


def _in_parts(
    compute: Callable[[Tensor, float], Coefficients], linear: Tensor, h: float
) -> Coefficients:
    """Return complex coefficients, computed for some values at a time."""
    size = VALUES_AT_ONCE if linear.device.type == "cpu" else VALUES_ON_DEVICE
    z = (h * linear).flatten()
    # The gradient of an odd derivative with coefficient 0 is imaginary.
    if z.is_complex() and not z.requires_grad and not z.imag.any():
        z = z.real
    parts = [compute(part, h) for part in z.split(size)]
    # Complex even if L is real: a real factor of the modes would be converted at every use.
    whole = [torch.cat(each).to(torch.complex128) for each in zip(*parts, strict=True)]
    return Coefficients(*(each.reshape(linear.shape) for each in whole))


def _coefficients(z: Tensor, h: float) -> Coefficients:
    """Return the coefficients for ``z = hL``."""
    half, of_half = phi_functions(z / 2, 1)
    full, one, two, three = phi_functions(z, 3)
    return Coefficients(full, half, *_combined(of_half, one, two, three, h))


def _derivatives(z: Tensor, h: float) -> Coefficients:
    """Return the derivatives by L for ``z = hL``: ``φ_k' = φ_k − k φ_{k+1}``."""
    full, one, two, three, four = phi_functions(z, 4)
    half, first_of_half, second_of_half = phi_functions(z / 2, 2)
    slopes = one - two, two - 2 * three, three - 3 * four
    others = _combined((first_of_half - second_of_half) / 2, *slopes, h)
    return Coefficients(h * full, h / 2 * half, *(h * each for each in others))


def _combined(of_half: Tensor, one: Tensor, two: Tensor, three: Tensor, h: float) -> list[Tensor]:
    """Return the coefficients of N from ``φ_1(z/2)``, ``φ_1``, ``φ_2`` and ``φ_3``."""
    return [
        h / 2 * of_half,
        h * (one - 3 * two + 4 * three),
        h * (2 * two - 4 * three),
        h * (4 * three - two),
    ]
