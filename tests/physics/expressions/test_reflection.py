"""Axes with ends: exact solutions, and every expression its own mirror image."""

from __future__ import annotations

import math
from pathlib import Path

import pytest
import torch
from torch import Tensor

from dashred.data.observation_operator import ObservationOperator
from dashred.data.sensors import Sensor
from dashred.physics.forcing_basis import ForcingBasis
from dashred.physics.runs.initial_state_prior import StartPrior, field_rms, nominal_start
from dashred.physics.solvers.compiled_simulator import compile_system
from dashred.physics.solvers.forcing import Forcing
from dashred.physics.solvers.simulate import simulate
from dashred.physics.system import System, Term
from dashred.physics.tangents.tangent_linear import tangent_linear
from dashred.physics.terms.library import evaluate_terms, resolve
from dashred.physics.window import window_shapes
from tests import laws

HEAD = "system:\n  title: declared in a test\n"
REST = "recording: {twin: a, sensors: 4, noise: 0, duration: 4, every: 0.1}\n"
HEAT = """
  axes: {x: {length: 3, points: 24, ends: ENDS}}
  fields: {u: temperature}
  parameters: {a: 0.2}
  equations: {u: a*lap(u) - 0.1*u}
  start: {u: START}
  integrator: {dt: 0.05}
"""
STRING = """
  axes: {x: {length: 2, points: 32, ends: fixed}}
  fields: {w: deflection, p: velocity}
  parameters: {c: 1.5}
  equations: {w: p, p: c**2*lap(w)}
  start: {w: sin(pi*x/2) + 0.2*sin(3*pi*x/2), p: 0}
  integrator: {dt: 0.005}
"""
BENT = """
  axes: {x: {length: 4, points: 32, ends: ENDS}}
  fields: {u: first, v: second}
  equations:
    u: 0.1*lap(u) - u*d(u, x) + 0.3*v - u**3
    v: 0.2*lap(v) - 0.5*v + u
  start: {u: WAVE, v: 0.3*WAVE}
  spread: {u: 0.1, v: 0.1, length: 1}
  integrator: {dt: 0.02}
"""
WAVES = {"insulated": "1 + cos(pi*x/4)", "fixed": "sin(pi*x/4) + 0.3*sin(pi*x/2)"}
TERMS = (
    *("u", "1", "u**2", "u*v", "d(u, x)", "u*d(v, x)", "exp(u)", "sin(2*u)", "cos(v)", "abs(u)*u"),
    *("x*u", "d(u**2, x)", "lap(u*v)", "grad2(u)", "d(u, x, 3)", "u**3 + v**2", "1/(2 + u**2)"),
    *("sqrt(4 + u)", "step(u - 0.2)", "inv_lap(v)", "sin(x)*cos(t)", "tanh(u + v**2)"),
)
TIMES = torch.linspace(0.0, 1.0, 6, dtype=torch.float64)


def system_of(folder: Path, text: str, **words: str) -> System:
    for word, value in words.items():
        text = text.replace(word, value)
    return laws.declared(folder, HEAD + text[1:] + REST)


@pytest.fixture(scope="module", params=["insulated", "fixed"])
def bent(request: pytest.FixtureRequest, tmp_path_factory: pytest.TempPathFactory) -> System:
    folder = tmp_path_factory.mktemp("bent")
    return system_of(folder, BENT, ENDS=request.param, WAVE=WAVES[request.param])


def image(values: Tensor, odd: bool) -> Tensor:
    """Return the mirror image of values ``(…, point)`` on a ring."""
    mirrored = torch.roll(values.flip(-1), 1, dims=-1)
    return -mirrored if odd else mirrored


def test_heat_between_insulated_and_between_fixed_ends(tmp_path: Path) -> None:
    for ends, wave in (("insulated", torch.cos), ("fixed", torch.sin)):
        start = f"{wave.__name__}(2*pi*x/3)"
        system = system_of(tmp_path, HEAT, ENDS=ends, START=start)
        found = simulate(system, nominal_start(system), TIMES)[0, :, 0]
        rate = -0.2 * (2 * math.pi / 3) ** 2 - 0.1
        x = system.grid.own_coordinates["x"]
        expected = torch.exp(rate * TIMES)[:, None] * wave(2 * math.pi * x / 3)
        torch.testing.assert_close(system.grid.own(found), expected, rtol=1e-10, atol=1e-12)


def test_a_string_swings_in_its_own_time(tmp_path: Path) -> None:
    system = system_of(tmp_path, STRING)
    period = 2 * 2 / 1.5
    times = torch.tensor([0.0, period / 2, period], dtype=torch.float64)
    start = nominal_start(system)
    found = simulate(system, start, times)[0]
    torch.testing.assert_close(found[2], start[0], atol=2e-6, rtol=0)
    torch.testing.assert_close(found[1, 0], -start[0, 0], atol=2e-6, rtol=0)


def test_a_state_stays_its_own_image_and_compiled_runs_agree(bent: System) -> None:
    odd = bent.axes[0].ends == "fixed"
    # A third derivative that turns at the ends is stepped explicitly: too stiff for this step.
    texts = [text for text in TERMS if text != "d(u, x, 3)"]
    library = [Term("u", bent.parse(text, "test", equation="u")) for text in texts]
    terms = resolve(bent, library)
    start = nominal_start(bent)
    weights = 0.05 * torch.eye(len(terms), dtype=torch.float64)
    start = start.expand(len(terms), *start.shape[1:]).contiguous()
    found = simulate(bent, start, TIMES, Forcing(terms, weights))
    assert torch.isfinite(found).all()
    torch.testing.assert_close(image(found, odd), found, atol=1e-9, rtol=0)
    quick = compile_system(bent, terms)(start, TIMES, weights)
    torch.testing.assert_close(quick, found, atol=1e-9, rtol=0)


@pytest.mark.parametrize("text", TERMS)
def test_a_term_is_on_the_axis_what_it_says_and_beyond_its_image(bent: System, text: str) -> None:
    ends, length = bent.axes[0].ends, 4.0
    odd = ends == "fixed"
    term = Term("u", bent.parse(text, "test", equation="u"))
    [[found]] = evaluate_terms(bent, [term], nominal_start(bent), 0.3)
    torch.testing.assert_close(image(found, odd), found, atol=1e-9, rtol=0)
    # The interpreter on the axis alone, where a side is 1, reads the expression as it stands.
    plain = bent.evaluate(text, nominal_start(bent), 0.3)[0]
    inside = slice(1, bent.axes[0].points)
    if text == "inv_lap(v)":
        return
    torch.testing.assert_close(found[inside], plain[inside], atol=1e-9, rtol=0)
    assert bent.axes[0].length == length


def test_starts_and_forcings_are_their_own_images_and_vary_between_the_ends(bent: System) -> None:
    odd = bent.axes[0].ends == "fixed"
    nominal = nominal_start(bent)
    prior = StartPrior(bent, nominal[0], field_rms(nominal), None)
    z = torch.randn((200, prior.size), generator=torch.Generator().manual_seed(0)).double()
    starts = prior.start(z) - nominal
    torch.testing.assert_close(image(starts, odd), starts, atol=1e-12, rtol=0)
    middle = starts[:, 0, 8:25].std()
    assert float(middle) == pytest.approx(0.1, rel=0.15)
    forcing_basis = ForcingBasis.over(bent, TIMES, 6, 3)
    torch.testing.assert_close(
        image(forcing_basis.bumps, odd), forcing_basis.bumps, atol=1e-12, rtol=0
    )
    own = bent.grid.own(forcing_basis.bumps)[:, 1:-1]
    torch.testing.assert_close(own.sum(dim=0), torch.ones(own.shape[1]).double())
    tops = bent.grid.own_coordinates["x"][1:-1][own.argmax(dim=1)]
    assert (tops.diff() > 0).all()


def test_sensors_read_between_the_points_up_to_the_ends(bent: System) -> None:
    places = (0.0, 0.03, 1.234, 3.97, 4.0)
    sensors = [Sensor(f"s{j}", "u", (x,)) for j, x in enumerate(places)]
    read = ObservationOperator(sensors, bent)(nominal_start(bent))[0]
    x = torch.tensor(places, dtype=torch.float64)
    turn = math.pi * x / 4
    exact = 1 + torch.cos(turn)
    if bent.axes[0].ends == "fixed":
        exact = torch.sin(turn) + 0.3 * torch.sin(2 * turn)
    torch.testing.assert_close(read, exact, atol=1e-9, rtol=0)


def test_tangents_are_differences(bent: System) -> None:
    start = nominal_start(bent)[0]
    z = torch.randn((2, *start.shape), generator=torch.Generator().manual_seed(1)).double()
    odd = bent.axes[0].ends == "fixed"
    z = (z + image(z, odd)) / 2
    size = 1e-6
    moved = simulate(bent, torch.cat([start + size * z, start - size * z]), TIMES)
    difference = (moved[:2] - moved[2:]) / (2 * size)
    nothing = Forcing((), torch.zeros((1, 0), dtype=torch.float64))
    columns = [
        t.double() for _, t in tangent_linear(bent, start, z, TIMES, nothing, [], torch.float64)
    ]
    torch.testing.assert_close(torch.stack(columns, dim=1), difference, atol=1e-5, rtol=0)


def test_windows_do_not_go_around_the_ends(bent: System) -> None:
    box = next(shape for shape in window_shapes(bent) if shape.kind == "box")
    window = box.at((0.4, 0.4, math.log(0.05)))
    values = {"x": bent.grid.coordinates["x"]}
    term = Term("u", window.expression)
    [[found]] = evaluate_terms(bent, [term], nominal_start(bent), 0.0)
    own = bent.grid.own(found).abs()
    x = bent.grid.own_coordinates["x"]
    assert (own[(x > 0.2) & (x < 0.6)] > 0.95).all() and (own[x > 1.2] < 1e-3).all()
    assert len(values["x"]) == 64
