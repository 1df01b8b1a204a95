"""The methods within an analysis are compared by all that they propose."""

from __future__ import annotations

from typing import Any

from dashred.evaluation.comparison.method_scores import _analysis_results


def test_proposed_changes_of_parameters_belong_to_the_law(tmp_path: Any) -> None:
    term = {"equation": "u", "term": "u", "coefficient": 0.5, "inclusion": None, "rank": 1}
    unused = {**term, "term": "u**2", "coefficient": 0.0, "rank": 2}
    proposed = {"proposals": [term, unused], "rmse_path": []}
    findings = {
        "terms": [],
        "input": {"config": {"system": {"parameters": {"nu": 0.2, "c": 1.0}}}},
        "latent": {
            "alg1": None,
            "alg2": proposed,
            "dynamics": {**proposed, "parameters": {"nu": -0.05}},
        },
    }
    (tmp_path / "run.json").write_text('{"seconds": {}}')
    found = _analysis_results(tmp_path, findings, {})
    assert "latent_alg1" not in found
    assert found["latent_alg2"]["terms"] == [term]
    change = {"equation": None, "parameter": "nu", "to": 0.2 - 0.05}
    assert found["latent_dynamics"]["terms"] == [term, change]
