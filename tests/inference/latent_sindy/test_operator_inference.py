"""Steps fitted to snapshots, compared with a system whose steps are known exactly."""

from __future__ import annotations

import numpy as np
import torch

from dashred.config import Integrator
from dashred.config import System as Declared
from dashred.inference.latent_sindy.operator_inference import SnapshotSteps
from dashred.models.pod import POD
from dashred.physics.system import System
from dashred.physics.terms.library import build_library

DT = 0.05


def runs(members: int = 24, samples: int = 30) -> torch.Tensor:
    """Return a quadratic map, a' = a + dt (b - a, a b - 0.5 b): ``(member, time, field)``."""
    state = torch.from_numpy(np.random.default_rng(0).uniform(-1, 1, (members, 2)))
    path = [state]
    for _ in range(samples - 1):
        a, b = path[-1].unbind(-1)
        path.append(path[-1] + DT * torch.stack([b - a, a * b - 0.5 * b], dim=-1))
    return torch.stack(path, dim=1)


def fitted() -> tuple[SnapshotSteps, torch.Tensor]:
    integrator = Integrator(None, None, False, "spectral", 1e-9, 1e-9)
    fields = {"a": "first", "b": "second"}
    system = System(Declared(title="T", fields=fields, integrator=integrator), lambda key: key)
    library = build_library(system, {"a": ["a", "a*b"], "b": ["b"]})
    states = runs()
    pod = POD.fit(states[:-8].flatten(0, 1), 2)
    return SnapshotSteps.fit(system, library, pod, states, 8, [1, 2]), states


def test_a_quadratic_step_is_fitted_exactly() -> None:
    steps, _ = fitted()
    assert steps.errors[1] < 1e-4
    assert steps.errors[2] < 0.02
    new = torch.tensor([[0.3, -0.6]], dtype=torch.float64)
    [step] = steps.forecasts(new, torch.tensor([0.0]), torch.tensor([0]), [1])
    expected = new + DT * torch.tensor([[-0.9, 0.3 * -0.6 + 0.3]], dtype=torch.float64)
    torch.testing.assert_close(step.forecast, expected, rtol=0, atol=1e-5)


def test_columns_are_the_terms_times_the_step() -> None:
    steps, states = fitted()
    times = DT * torch.arange(30, dtype=torch.float64)
    begins = torch.tensor([3, 10])
    made = steps.forecasts(states[0], times, begins, [1, 2])
    single, double = steps.columns(states[0], times, made)
    a, b = states[0, begins].unbind(-1)
    zero = torch.zeros_like(a)
    terms = [(a, zero), (a * b, zero), (zero, b)]
    expected = DT * torch.stack([torch.stack(pair, dim=-1) for pair in terms], dim=1)
    torch.testing.assert_close(single, expected)
    torch.testing.assert_close(double, 2 * expected)
