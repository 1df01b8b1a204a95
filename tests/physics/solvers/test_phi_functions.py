"""The φ functions against contour integrals, their limits and their derivatives."""

from __future__ import annotations

import math

import pytest
import torch
from torch import Tensor

from dashred.physics.solvers.etdrk4 import coefficient_derivatives, coefficients
from dashred.physics.solvers.phi_functions import SMALL, phi_functions

COUNT = 4
SIZES = [0.0, 1e-300, 1e-12, 1e-3, 0.5, SMALL - 1e-9, SMALL, SMALL + 1e-9, 3.0, 40.0]
ANGLES = [0.0, 0.3, math.pi / 2, 2.0, math.pi]


def by_contour(z: complex, k: int) -> complex:
    """Return φ_k as the mean over a circle (Kassam & Trefethen 2005), where nothing cancels."""
    angles = 2 * math.pi * (torch.arange(64, dtype=torch.float64) + 0.5) / 64
    r = z + 2 * torch.exp(1j * angles)
    value = torch.exp(r)
    for j in range(k):
        value = (value - 1 / math.factorial(j)) / r
    return complex(value.mean())


@pytest.mark.parametrize("angle", ANGLES)
@pytest.mark.parametrize("size", SIZES)
def test_they_agree_with_contour_integrals(size: float, angle: float) -> None:
    z = torch.polar(torch.tensor([size]).double(), torch.tensor([angle]).double())
    for k, found in enumerate(phi_functions(z, COUNT)):
        exact = by_contour(complex(z), k)
        assert abs(complex(found) - exact) < 2e-14 * max(abs(exact), 1 / math.factorial(k))


def test_real_values_stay_real() -> None:
    z = torch.linspace(-30, 3, 101, dtype=torch.float64)
    for real, full in zip(phi_functions(z, COUNT), phi_functions(z + 0j, COUNT), strict=True):
        assert real.dtype == torch.float64
        torch.testing.assert_close(real + 0j, full, rtol=1e-14, atol=0)


def test_gradients_are_finite_and_follow_the_identity() -> None:
    z = torch.tensor([-50.0, -1.0, -1e-9, 0.0, 0.7, 2.0], dtype=torch.float64, requires_grad=True)
    found = phi_functions(z, COUNT)
    for k in range(1, COUNT):
        [slope] = torch.autograd.grad(found[k].sum(), z, retain_graph=True)
        torch.testing.assert_close(slope, found[k] - k * found[k + 1], rtol=1e-12, atol=1e-14)


@pytest.mark.parametrize("kind", ["real", "complex"])
def test_derivatives_of_the_coefficients(kind: str) -> None:
    h, move = 0.3, 1e-5
    linear: Tensor = torch.tensor([-200.0, -7.0, -0.2, 0.0, 1.0], dtype=torch.float64)
    if kind == "complex":
        linear = linear + 1j * linear.flip(0)
    ahead, behind = coefficients(linear + move, h), coefficients(linear - move, h)
    for exact, high, low in zip(coefficient_derivatives(linear, h), ahead, behind, strict=True):
        assert exact.dtype == torch.complex128 and exact.shape == linear.shape
        torch.testing.assert_close((high - low) / (2 * move), exact, rtol=1e-6, atol=1e-9)
