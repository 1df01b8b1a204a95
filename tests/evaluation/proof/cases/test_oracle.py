"""The oracle: it knows the true form, and says whether the recording could have told it."""

from __future__ import annotations

import json
import shutil
from dataclasses import replace
from pathlib import Path
from typing import Any

import pytest
import torch

from dashred.core.findings.findings import write_json_atomic
from dashred.data.io.write_netcdf import write_netcdf
from dashred.evaluation.proof.cases.draw import Case
from dashred.evaluation.proof.cases.effect_size import CaseTruth, record_truth
from dashred.evaluation.proof.cases.oracle import _nearest_rival, compute_oracle
from dashred.pipeline.outputs.field_files import write_estimates

CHECKOUT = Path(__file__).resolve().parents[4]
TERM = {"equation": "v", "term": "v**2", "coefficient": 1.0}
CASE = Case(0, "cases", "fhn", "terms", (5, 0, 0), 0.03, 10, {"terms": [TERM]}, 8.0)


@pytest.fixture(scope="module")
def recorded(tmp_path_factory: pytest.TempPathFactory) -> tuple[Path, CaseTruth]:
    folder = tmp_path_factory.mktemp("case")
    concealed = record_truth(CASE)
    write_netcdf(concealed.recording, folder / "recording.nc", ["x"])
    times = concealed.truth.times[:3]
    # Its start is the true one but for a tenth, as no run would find it.
    found = {"simulation": torch.zeros_like(concealed.truth.states[:3])}
    found["corrected"] = 1.1 * concealed.truth.states[:3]
    write_estimates(folder / "estimates.nc", concealed.system, times, found)
    return folder, concealed


def told(
    folder: Path, law: str, term: dict[str, Any] | None, alternatives: list[dict[str, Any]]
) -> None:
    """Leave the findings and the corrected simulator that a run leaves which found one term."""
    terms = [] if term is None else [term | {"region": None}]
    write_json_atomic(folder / "findings.json", {"terms": terms, "alternatives": alternatives})
    text = (CHECKOUT / "conf" / "fhn.yaml").read_text()
    right = "    v: eps*(u + a - b*v) + Dv*lap(v)"
    assert right in text
    (folder / "corrected.yaml").write_text(text.replace(right, right + law))


def alternative(term: dict[str, Any], delta: float) -> dict[str, Any]:
    return {"terms": [term | {"window": None}], "delta_bic": delta, "rival": delta < 6}


def test_a_law_that_was_found_loses_nothing_and_its_rivals_decide(recorded) -> None:
    folder, concealed = recorded
    coefficient = concealed.truth.terms[0].coefficient
    found = {"equation": "v", "term": "v**2", "coefficient": coefficient}
    other = {"equation": "u", "term": "u", "coefficient": 0.1}
    told(folder, f" + {coefficient}*v**2", found, [alternative(other, 9.0)])
    answer = compute_oracle(CASE, concealed, folder, exact=True)
    assert answer is not None and abs(answer["lost"]) < 3 < 50 < answer["over_null"]
    assert answer["over_rival"] == pytest.approx(9.0 + answer["lost"])
    assert answer["decidable"] and answer["over_library"] == pytest.approx(answer["lost"])
    told(folder, f" + {coefficient}*v**2", found, [alternative(other, 2.0)])
    near = compute_oracle(CASE, concealed, folder, exact=True)
    assert near is not None and not near["decidable"]


def test_a_law_that_holds_the_best_one_is_no_rival_of_it() -> None:
    best = {"equation": "v", "term": "v**2", "region": None, "window": None}
    more = [best, {"equation": "u", "term": "u", "window": None}]
    later = [best | {"window": {"axis": "t", "from": -0.2}}]
    other = [{"equation": "u", "term": "u", "window": None}]

    def nearest(*laws: list[dict[str, Any]], best: dict[str, Any] = best) -> float | None:
        alternatives = [{"terms": law, "delta_bic": float(j)} for j, law in enumerate(laws)]
        return _nearest_rival({"terms": [best], "alternatives": alternatives})

    assert nearest(more, later, other) == 2.0
    assert nearest(more, later) is None
    # Of a law in a window the one everywhere is a rival, and so is another window.
    boxed = best | {"region": [{"axis": "x", "from": 1.0, "to": 2.0}]}
    assert nearest([best], best=boxed) == nearest(later, best=boxed) == 0.0


def test_what_was_missed_is_lost(recorded) -> None:
    folder, concealed = recorded
    told(folder, "", None, [])
    answer = compute_oracle(CASE, concealed, folder, exact=False)
    assert answer is not None and answer["lost"] == pytest.approx(answer["over_null"])
    assert answer["lost"] > 50 and answer["decidable"]


def test_a_law_that_blows_up_loses_all(recorded) -> None:
    folder, concealed = recorded
    wrong = {"equation": "v", "term": "v**3", "coefficient": 50.0}
    told(folder, " + 50*v**3", wrong, [])
    answer = compute_oracle(CASE, concealed, folder, exact=False)
    assert answer is not None and answer["lost"] is not None
    assert 1e5 < answer["lost"] < float("inf")
    json.dumps(answer, allow_nan=False)


def test_where_nothing_was_returned_the_simulator_as_it_is_stands_for_it(
    recorded, tmp_path
) -> None:
    folder, concealed = recorded
    shutil.copy(folder / "recording.nc", tmp_path)
    write_json_atomic(tmp_path / "findings.json", {"terms": None, "alternatives": None})
    answer = compute_oracle(CASE, concealed, tmp_path, exact=False)
    assert answer is not None and answer["decidable"]
    assert answer["lost"] == answer["over_null"] == answer["over_library"]
    assert answer["over_null"] > 50


def test_it_has_nothing_to_say_where_no_law_was_hidden(recorded, tmp_path) -> None:
    _, concealed = recorded
    lawless = replace(concealed, truth=replace(concealed.truth, terms=()))
    assert compute_oracle(CASE, lawless, tmp_path, exact=False) is None
