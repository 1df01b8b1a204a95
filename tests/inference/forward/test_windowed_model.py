"""Shooting with windows and with a free forcing: their Jacobians against differences."""

from __future__ import annotations

import math

import pytest
import torch
from torch import Tensor

from dashred.inference.forward.candidates import forcing_of
from dashred.inference.forward.forced_model import DrivenShooting
from dashred.inference.forward.forward_model import Shooting
from dashred.inference.forward.windowed_model import LocalShooting, localised
from dashred.physics.forcing_basis import Pulses
from dashred.physics.solvers.simulate import simulate
from dashred.physics.window import Shape, box, gate, onset
from tests.waves import TIMES, Waves

SHORT = TIMES[:13]


def unknowns(waves: Waves, count: int) -> tuple[Tensor, Tensor]:
    generator = torch.Generator().manual_seed(0)
    z = 0.5 * torch.randn(waves.start.size, generator=generator).double()
    return z, 0.1 * torch.randn(count, generator=generator).double()


def check(shooting: Shooting, z: Tensor, xi: Tensor) -> None:
    """Hold tangents to central differences, which have the error of the tangents' precision."""
    exact, rough = shooting.linearise(z, xi), shooting._difference(z, xi)
    torch.testing.assert_close(exact.readings, rough.readings)
    for found, expected in ((exact.by_start, rough.by_start), (exact.by_error, rough.by_error)):
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
def test_a_window_s_edges_are_unknowns_like_any_other(waves: Waves, kind: str) -> None:
    shape, guess = shapes(waves)[kind]
    everywhere = waves.candidates(["u: u**3"])
    inside = waves.candidates(["v: 1", "u: u"])
    shooting = LocalShooting(
        waves.simulator,
        waves.start,
        everywhere,
        waves.operator,
        SHORT,
        inside,
        shape,
        torch.tensor(guess, dtype=torch.float64),
    )
    z, xi = unknowns(waves, 3 + len(guess))
    check(shooting, z, xi)
    # The window is where the guess and the unknowns say, and its law is a law like any other.
    window = shooting.window(xi)
    assert window.values == pytest.approx(
        [g + float(d) for g, d in zip(guess, xi[3:], strict=True)]
    )
    found = [*everywhere, *localised(inside, window)]
    assert [c.window for c in found] == [None, window, window]
    path = simulate(
        waves.system, waves.start.start(z[None]), SHORT, forcing_of(found, xi[None, :3])
    )
    torch.testing.assert_close(waves.operator(path), shooting.readings(z[None], xi[None]))


def test_a_free_forcing_s_amplitudes_are_too(waves: Waves) -> None:
    pulses = Pulses.over(waves.system, SHORT, cells=3, knots=3)
    size = torch.tensor([0.5, 0.2], dtype=torch.float64)
    candidates = waves.candidates(["u: u", "v: 1"])
    plain = Shooting(waves.simulator, waves.start, candidates, waves.operator, SHORT)
    shooting = DrivenShooting.on(plain, pulses, size)
    z, xi = unknowns(waves, 2 + pulses.count)
    check(shooting, z, xi)
    none = shooting.readings(z[None], torch.cat([xi[:2], 0 * xi[2:]])[None])
    torch.testing.assert_close(none, plain.readings(z[None], xi[None, :2]))
    assert shooting.scales.shape == xi.shape
    part = shooting.until(5).readings(z[None], xi[None])
    torch.testing.assert_close(part, shooting.readings(z[None], xi[None])[:, :5])


def test_a_law_in_a_window_may_be_forced_too(waves: Waves) -> None:
    shape, guess = shapes(waves)["box"]
    pulses = Pulses.over(waves.system, SHORT, cells=2, knots=2)
    law = LocalShooting(
        waves.simulator,
        waves.start,
        [],
        waves.operator,
        SHORT,
        waves.candidates(["u: u"]),
        shape,
        torch.tensor(guess, dtype=torch.float64),
    )
    size = torch.tensor([0.5, 0.2], dtype=torch.float64)
    check(DrivenShooting.on(law, pulses, size), *unknowns(waves, 4 + pulses.count))
