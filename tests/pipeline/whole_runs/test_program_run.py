"""A whole run in which the simulator is a function, whose equations dashred does not know."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pytest
import yaml

from tests.pipeline.whole_runs.test_episodes_run import SMALL, findings_of

pytestmark = pytest.mark.slow

TEXT = """
system:
  title: Pendulum
  fields: {theta: angle, omega: rate}
  parameters: {g: 4.0}
  simulator: {function: tests.programs.pendulum}
  start: {theta: 1.2, omega: 0.3}
  spread: {theta: 0.2, omega: 0.2}
recording: {path: recording.csv}
"""
DAMPING = -0.15
TIMES = np.arange(0, 24, 0.1)


def recorded(path: Path) -> None:
    """Write the angle of a damped pendulum, in short steps of another method."""
    theta, omega, short, read = 1.25, 0.2, 1e-4, []
    for step in range(round(TIMES[-1] / short) + 1):
        if step % 1000 == 0:
            read.append(theta)
        omega += short * (-4 * np.sin(theta) + DAMPING * omega)
        theta += short * omega
    noisy = np.array(read) + 0.005 * np.random.default_rng(3).standard_normal(len(read))
    rows = [f"{t:.7g},{x:.7g}" for t, x in zip(TIMES, noisy, strict=True)]
    path.write_text("time,theta\n" + "\n".join(rows) + "\n")


def test_the_law_beside_a_function_is_found_and_corrects_it(train: Any, tmp_path: Path) -> None:
    recorded(tmp_path / "recording.csv")
    (tmp_path / "pendulum.yaml").write_text(TEXT + SMALL)
    ended = train(f"conf={tmp_path / 'pendulum.yaml'}", "trust=tests.programs.pendulum")
    found = findings_of(ended)
    assert found["verdict"] == "missing-term"
    [term] = found["terms"]
    # The equation of theta only defines omega: it has no candidates.
    assert (term["equation"], term["term"]) == ("omega", "omega")
    assert term["coefficient"] == pytest.approx(DAMPING, abs=0.002)
    corrected = yaml.safe_load(ended.read("corrected.yaml"))["system"]
    assert corrected["simulator"] == {"function": "tests.programs.pendulum"}
    assert list(corrected["equations"]) == ["omega"]
    held = found["fit"]["heldout_restarted"]
    assert held["corrected"] < 0.2 * held["simulation_refit"]
