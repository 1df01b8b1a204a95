"""The forward model with windows and with a free forcing: their Jacobians against differences."""

from __future__ import annotations

import math
from dataclasses import replace

import pytest
import torch
from torch import Tensor

from dashred.inference.forward.candidates import build_forcing
from dashred.inference.forward.forcing_block import ForcingBlock
from dashred.inference.forward.forward_model import ForwardModel
from dashred.inference.forward.law_block import LawBlock, WindowedTerms, restrict_to_window
from dashred.physics.forcing_basis import ForcingBasis
from dashred.physics.solvers.simulate import simulate
from dashred.physics.window import Shape, box, gate, onset
from tests.waves import TIMES, Waves

SHORT = TIMES[:13]


def unknowns(waves: Waves, count: int) -> tuple[Tensor, Tensor]:
    generator = torch.Generator().manual_seed(0)
    z = 0.5 * torch.randn(waves.start.size, generator=generator).double()
    return z, 0.1 * torch.randn(count, generator=generator).double()


def check(forward_model: ForwardModel, z: Tensor, xi: Tensor) -> None:
    """Compare tangents with central differences, within the precision of the tangents."""
    exact, rough = forward_model.linearise(z, xi), forward_model._differences(z, xi)
    torch.testing.assert_close(exact.readings, forward_model.readings(z[None], xi[None])[0])
    by_start, by_coefficients = rough.split([len(z), len(xi)], dim=-1)
    for found, expected in ((exact.by_start, by_start), (exact.by_coefficients, by_coefficients)):
        size = expected.norm(dim=(0, 1))
        assert (size > 0).all()
        assert float(((found - expected).norm(dim=(0, 1)) / size).max()) < 2e-3


def shapes(waves: Waves) -> dict[str, tuple[Shape, list[float]]]:
    return {
        "box": (box(waves.system.axes[0]), [3.0, 2.0, math.log(0.6)]),
        "onset": (onset(), [1.4, math.log(0.4)]),
        "gate": (gate("u", 1), [0.3, math.log(0.4)]),
    }


@pytest.mark.parametrize("kind", ["box", "onset", "gate"])
def test_the_jacobian_of_window_edges(waves: Waves, kind: str) -> None:
    shape, guess = shapes(waves)[kind]
    everywhere = waves.candidates(["u: u**3"])
    inside = waves.candidates(["v: 1", "u: u"])
    windowed = WindowedTerms(inside, shape, torch.tensor(guess, dtype=torch.float64))
    forward_model = waves.forward_model(LawBlock(everywhere, windowed), SHORT)
    z, xi = unknowns(waves, 3 + len(guess))
    check(forward_model, z, xi)
    # The window is at the guess plus the unknowns; the windowed law equals an ordinary term.
    window = windowed.window(xi[1:])
    assert window.values == pytest.approx(
        [g + float(d) for g, d in zip(guess, xi[3:], strict=True)]
    )
    found = [*everywhere, *restrict_to_window(inside, window)]
    assert [c.window for c in found] == [None, window, window]
    path = simulate(
        waves.system, waves.start.start(z[None])[0], SHORT, build_forcing(found, xi[None, :3])
    )
    torch.testing.assert_close(waves.operator(path), forward_model.readings(z[None], xi[None]))


def test_the_jacobian_of_forcing_amplitudes(waves: Waves) -> None:
    forcing_basis = ForcingBasis.over(waves.system, SHORT, cells=3, knots=3)
    size = torch.tensor([0.5, 0.2], dtype=torch.float64)
    candidates = waves.candidates(["u: u", "v: 1"])
    plain = waves.forward_model(LawBlock(candidates), SHORT)
    forward_model = replace(plain, forcing=ForcingBlock(forcing_basis, size))
    z, xi = unknowns(waves, 2 + forcing_basis.count)
    check(forward_model, z, xi)
    none = forward_model.readings(z[None], torch.cat([xi[:2], 0 * xi[2:]])[None])
    torch.testing.assert_close(none, plain.readings(z[None], xi[None, :2]))
    assert forward_model.scales.shape == xi.shape
    part = forward_model.truncate(5).readings(z[None], xi[None])
    torch.testing.assert_close(part, forward_model.readings(z[None], xi[None])[:, :5])


def test_a_windowed_law_with_a_free_forcing(waves: Waves) -> None:
    shape, guess = shapes(waves)["box"]
    forcing_basis = ForcingBasis.over(waves.system, SHORT, cells=2, knots=2)
    edges = torch.tensor(guess, dtype=torch.float64)
    law = LawBlock([], WindowedTerms(waves.candidates(["u: u"]), shape, edges))
    size = torch.tensor([0.5, 0.2], dtype=torch.float64)
    block = ForcingBlock(forcing_basis, size)
    forced = replace(waves.forward_model(law, SHORT), forcing=block)
    check(forced, *unknowns(waves, 4 + block.count))
