"""PySINDy on full states with a known law."""

from __future__ import annotations

import numpy as np
import pytest
from pysindy import STLSQ

from dashred.evaluation.foreign.peers.full_state import FullState
from dashred.evaluation.foreign.peers.sindy import ensemble_sindy, weak_sindy
from dashred.evaluation.foreign.peers.sparse import sparse_law
from dashred.physics.terms.library import build_library
from tests.evaluation.foreign.invented import system_of

SPIRAL = {
    "title": "Spiral",
    "fields": {"x": "first", "y": "second"},
    "equations": {"x": "-y", "y": "x - 0*y"},
    "start": {"x": 1, "y": 0},
    "spread": {"x": 0.1, "y": 0.1},
    "integrator": {"method": "rk4", "dt": 0.01},
}


def test_the_sparse_law_has_the_true_columns_only() -> None:
    rng = np.random.default_rng(0)
    columns = rng.standard_normal((300, 8)) * np.geomspace(1, 1e3, 8)
    target = 2 * columns[:, 1] - 0.01 * columns[:, 5] + 0.05 * rng.standard_normal(300)
    law = sparse_law(columns, target, lambda threshold: STLSQ(threshold, 1e-6))
    assert set(np.flatnonzero(law)) == {1, 5}
    np.testing.assert_allclose(law[[1, 5]], [2, -0.01], rtol=0.02)


@pytest.mark.parametrize("method", [weak_sindy, ensemble_sindy])
def test_a_damping_is_found_in_the_full_state(method) -> None:
    """X' = −y, y' = x − y/5 with a simulator that lacks the damping."""
    times = np.linspace(0, 12, 300)
    rate = np.sqrt(1 - 0.01)
    x = np.exp(-0.1 * times) * np.cos(rate * times)
    y = np.exp(-0.1 * times) * (0.1 * np.cos(rate * times) + rate * np.sin(rate * times))
    system = system_of(SPIRAL)
    library = build_library(system, {"y": ["1", "x", "y", "x**2", "x*y", "y**2"]})
    full = FullState(system, library, times, np.stack([x, y], axis=1), 0.005, 3)
    [term] = method(full)
    assert (term["equation"], term["term"]) == ("y", "y")
    assert term["coefficient"] == pytest.approx(-0.2, rel=0.1)
