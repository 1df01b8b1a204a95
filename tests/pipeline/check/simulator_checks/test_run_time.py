"""The run time that a check states, and a simulation that is too slow for its budget."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

from dashred.pipeline.check.simulator_checks.run_time import run_time_remark
from dashred.pipeline.check.simulator_checks.simulator import run_nominal
from tests.pipeline.check.simulator_checks.test_observability import decay


def test_a_fast_simulation_is_no_error(tmp_path: Path) -> None:
    context = decay(tmp_path)
    found = run_time_remark(context, run_nominal(context), None)
    assert found.text.startswith("About") and found.kind != "error"


def test_a_simulation_that_a_run_would_end_is_an_error(tmp_path: Path) -> None:
    context = decay(tmp_path)
    nominal = replace(run_nominal(context), sample_seconds=1.0)
    found = run_time_remark(context, nominal, None)
    assert found.kind == "error"
    assert "takes about 2 min" in found.text and "may take 1 min of its 300 s" in found.text
