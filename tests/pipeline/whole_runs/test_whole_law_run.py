"""A whole run in which the simulator knows none of the system's law."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import pytest

from tests.pipeline.discovery.segments.test_whole_law import LORENZ, TEXT, recorded
from tests.pipeline.whole_runs.test_episodes_run import SMALL, findings_of

pytestmark = pytest.mark.slow


def test_all_seven_terms_of_the_lorenz_system_are_told(train: Any, tmp_path: Path) -> None:
    recorded(tmp_path / "readings.csv", 0.5)
    (tmp_path / "case.yaml").write_text(TEXT + SMALL)
    words = (f"conf={tmp_path / 'case.yaml'}", f"recording.path={tmp_path / 'readings.csv'}")
    found = findings_of(train(*words))
    assert found["verdict"] == "missing-term"
    law = {f"{term['equation']}: {term['term']}": term["coefficient"] for term in found["terms"]}
    assert law == pytest.approx(LORENZ, rel=0.1)
    held = found["fit"]["heldout_restarted"]
    assert held["corrected"] < 0.5 * held["simulation_refit"]
