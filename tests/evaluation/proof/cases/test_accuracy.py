"""How near a law came: windows, coefficients and gains, in the units in which they are judged."""

from __future__ import annotations

from types import SimpleNamespace
from typing import Any, cast

import pytest
import torch

from dashred.core.findings.findings import freeze, write_json_atomic
from dashred.core.findings.schema import Score
from dashred.data.sensors import Sensor
from dashred.evaluation.proof.cases.accuracy import (
    coefficients_found,
    gains,
    noisy_test_change,
    peak_inside,
    region_errors,
)
from dashred.evaluation.proof.cases.effect_size import CaseTruth
from dashred.evaluation.twins.sealing import Concealed as Hidden
from dashred.evaluation.twins.sealing import SealedTerm
from dashred.pipeline.outputs.field_files import write_estimates
from tests.evaluation.proof.scoring.test_judge import BOX, SYSTEM, V2, case_of, findings, term


def concealed(*terms: SealedTerm, **more: Any) -> CaseTruth:
    times = torch.arange(31, dtype=torch.float64)
    states = torch.zeros((31, 2, 64), dtype=torch.float64)
    states[:, 0] = torch.linspace(-1, 1, 64, dtype=torch.float64)
    # After the record the state goes farther: that is no range of it.
    states[21:, 0] *= 10
    truth = SimpleNamespace(
        terms=terms, concealed=Hidden(**more), times=times, duration=20.0, states=states
    )
    sensors = [Sensor("s01", "u", (1.0,)), Sensor("s02", "u", (7.0,))]
    recording = SimpleNamespace(sensors=sensors)
    return cast(CaseTruth, SimpleNamespace(truth=truth, system=SYSTEM, recording=recording))


def scored(**region: float | None) -> Score:
    whole = {"overlap": None, "onset": None, "threshold": None} | region
    forecast = {"simulation_same_start": 2.0, "simulation_refit": 0.5, "corrected": 0.1}
    return cast(Score, {"region": whole, "forecast": forecast, "exact_support": True})


def test_of_a_parameter_the_change_counts() -> None:
    change: dict[str, Any] = {"equation": None, "parameter": "c", "term": "c"}
    change |= {"coefficient": 0.07, "std": 0.001, "from": 1.0, "to": 1.07}
    change |= {"region": None, "ci95": [1.02, 1.09]}
    [found] = coefficients_found(findings("parameter", change), concealed(parameters={"c": 1.03}))
    assert found["true"] == pytest.approx(0.03) and found["found"] == 0.07
    # The interval is one of the value itself.
    assert found["covered"]
    [found] = coefficients_found(findings("parameter", change), concealed(parameters={"c": 1.01}))
    assert not found["covered"]


def test_a_term_written_otherwise_is_the_same_coefficient() -> None:
    entry = term("v", "2*v*v") | {"coefficient": 0.016, "std": 0.001, "ci95": [0.014, 0.018]}
    [found] = coefficients_found(findings("missing-term", entry), concealed(V2))
    assert found["true"] == pytest.approx(0.015) and found["window"] is None and found["covered"]
    box = [{"axis": "x", "from": 3.1, "to": 7.9, "std": 0.1}]
    entry = term("v", "v**2", box) | {"std": 0.001, "ci95": [0.0305, 0.0325]}
    told = findings("missing-term", entry)
    [found] = coefficients_found(told, concealed(SealedTerm("v", "v**2", 0.03, BOX)))
    assert found["window"] == "box" and found["true"] == 0.03 and not found["covered"]


def test_an_onset_is_a_share_of_the_record_and_a_threshold_of_the_states_range() -> None:
    onset = SealedTerm("v", "v", 0.1, ("t", 10.0, None, 0.1))
    told = findings("missing-term", term("v", "v", [{"axis": "t", "from": 11.0, "std": 0.2}]))
    assert region_errors(scored(onset=1.0), told, concealed(onset)) == {
        "overlap": None,
        "onset": 0.05,
        "threshold": None,
        "threshold_z": None,
    }
    gate = SealedTerm("v", "v", 0.1, ("u", 0.5, None, 0.1))
    told = findings("missing-term", term("v", "v", [{"field": "u", "above": 0.6, "std": 0.05}]))
    found = region_errors(scored(threshold=0.1), told, concealed(gate))
    assert found is not None and found["threshold"] == pytest.approx(0.05)
    assert found["threshold_z"] == pytest.approx(2.0)
    # Of another term than the hidden one neither says anything; where it acts it does.
    other = cast(Score, {**scored(threshold=0.1, onset=1.0, overlap=0.9), "exact_support": False})
    assert region_errors(other, told, concealed(gate)) == {
        "overlap": 0.9,
        "onset": None,
        "threshold": None,
        "threshold_z": None,
    }


def test_the_maps_peak_is_inside_of_the_hidden_region_or_not() -> None:
    truth, case = concealed(SealedTerm("v", "v**2", 0.03, BOX)), case_of("box")
    told = findings("missing-term")
    for peak, inside in ((5.0, True), (9.0, False)):
        told["where"] = {"forcing": {"peak": [peak]}}
        assert peak_inside(case, told, truth) is inside
    told["where"] = {"forcing": None}
    assert peak_inside(case, told, truth) is None


def test_gains_are_against_the_truth_without_noise(tmp_path) -> None:
    truth = concealed(V2)
    times = truth.truth.times[:17]
    real = truth.truth.states[:17]
    fields = {"simulation_refit": real + 0.3, "corrected": real - 0.1}
    fields["simulation_same_start"] = real - 0.7
    write_json_atomic(tmp_path / "findings.json", {})
    write_estimates(tmp_path / "estimates.nc", SYSTEM, times, fields)
    freeze(tmp_path, ["estimates.nc"])
    told = findings("missing-term", term("v", "v**2"))
    told["input"]["splits"] = {"test": ["s02"]}
    found = gains(case_of("terms"), told, truth, tmp_path, scored())
    assert found is not None
    assert dict(found) == {
        "test_sensors": pytest.approx(3.0),
        "forecast": pytest.approx(5.0),
        "test_sensors_before": pytest.approx(7.0),
        "forecast_before": pytest.approx(20.0),
    }


def test_on_noisy_data_worse_is_above_nothing() -> None:
    told: dict[str, Any] = {"fit": {"test_sensors": {"simulation_refit": 0.5, "corrected": 0.6}}}
    assert noisy_test_change(told) == pytest.approx(0.2)
    assert noisy_test_change({"fit": None}) is None
    # A corrected simulation that blows up has no error, and is no better for it.
    endless = {"fit": {"test_sensors": {"simulation_refit": 0.5, "corrected": None}}, "terms": [V2]}
    assert noisy_test_change(endless) == 1e6
