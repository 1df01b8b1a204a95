"""What a recording cannot tell from others is foreseen, and most of it is drawn again."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import pytest
import xarray as xr

from dashred.data.io.write_netcdf import write_netcdf
from dashred.evaluation.proof.cases import record_case as recording
from dashred.evaluation.proof.cases.draw import Case, draw_cases, redraw, seed_of
from dashred.evaluation.proof.cases.effect_size import record_truth
from dashred.evaluation.proof.cases.identifiability import score_margin
from dashred.evaluation.proof.cases.record_case import MAX_DRAWS, record_case


def case_of(effect: float, *terms: tuple[str, str, float]) -> Case:
    """Return a case of the proof's smallest system, its terms in shares of a tendency."""
    law = [{"equation": e, "term": term, "coefficient": share} for e, term, share in terms]
    return Case(3, "cases", "fhn", "terms", (7, 0, 3), 0.03, 12, {"terms": law}, effect)


def lead_of(case: Case, folder: Path) -> float:
    concealed = record_truth(case)
    write_netcdf(concealed.recording, folder / "recording.nc", ["x"])
    return score_margin(case, concealed, folder / "recording.nc")


@pytest.mark.slow
def test_a_law_is_the_clearer_the_more_it_does(tmp_path) -> None:
    faint, weak, strong = (
        lead_of(case_of(effect, ("v", "v**2", 1.0)), tmp_path) for effect in (0.05, 2.0, 20.0)
    )
    # What does next to nothing is worse than no law, by what its freedom costs.
    assert -20 < faint < -10
    assert faint < weak < strong and strong > 12


@pytest.mark.slow
def test_a_faint_term_beside_a_strong_one_is_not_told_from_its_absence(tmp_path) -> None:
    alone = lead_of(case_of(20.0, ("v", "v**2", 1.0)), tmp_path)
    both = lead_of(case_of(20.0, ("v", "v**2", 1.0), ("u", "v**3", 1e-4)), tmp_path)
    assert both < 0 < alone


def test_a_case_drawn_again_is_another_of_its_kind() -> None:
    case = next(c for c in draw_cases(seed_of("a"), 20, 0) if c.kind == "terms")
    again, later = redraw(case, 1), redraw(redraw(case, 1), 2)
    assert (again.kind, again.system, str(again)) == (case.kind, case.system, str(case))
    assert case.hidden != again.hidden != later.hidden != case.hidden
    assert case.analysis_seed != again.analysis_seed
    assert redraw(case, 2) == later


def test_a_null_drawn_again_has_the_same_kind_of_difficulty() -> None:
    """The key of a case that was drawn again has one more entry."""
    drawn = draw_cases(seed_of("a"), 0, 30)
    assert sum(len(case.hidden) > 1 for case in drawn) == 10
    for case in drawn:
        assert redraw(case, 1).hidden.keys() == case.hidden.keys()


@pytest.mark.parametrize(("margins", "draws"), [([20.0], 1), ([3.0, -8.0, 13.0], 3)])
def test_unclear_cases_give_way_to_others(margins, draws, tmp_path, monkeypatch) -> None:
    monkeypatch.setattr(recording, "KEPT_SHARE", 0.0)
    drawn = iter(margins)
    monkeypatch.setattr(recording, "score_margin", lambda *_: next(drawn))
    path = tmp_path / "recording.nc"
    found = record_case(case_of(8.0, ("v", "v**2", 1.0)), path)
    assert found.draws == draws and next(drawn, None) is None
    with xr.open_dataset(path, engine="h5netcdf") as recorded:
        assert recorded.sizes["time"] == len(found.case_truth.recording.times)
        assert recorded.sizes["sensor"] == len(found.case_truth.recording.sensors)
    again = record_truth(found.case)
    assert (again.recording.values == found.case_truth.recording.values).all()


@pytest.mark.slow
def test_nobody_draws_for_ever_and_other_kinds_are_drawn_once(tmp_path, monkeypatch) -> None:
    monkeypatch.setattr(recording, "KEPT_SHARE", 0.0)
    monkeypatch.setattr(recording, "score_margin", lambda *_: 0.0)
    monkeypatch.setattr(recording, "MAX_DRAWS", 2)
    assert MAX_DRAWS > 2
    assert record_case(case_of(8.0, ("v", "v**2", 1.0)), tmp_path / "recording.nc").draws == 2
    null = next(
        c for c in draw_cases(seed_of("a"), 40, 0) if c.kind == "null" and c.system == "fhn"
    )
    assert record_case(null, tmp_path / "recording.nc").draws == 1


@pytest.mark.slow
def test_what_the_simulator_does_not_resolve_to_its_noise_is_drawn_again(
    tmp_path, monkeypatch
) -> None:
    monkeypatch.setattr(recording, "MAX_DRAWS", 3)
    path, entry = tmp_path / "recording.nc", {"terms": [], "spread": 6.5}
    key = seed_of("numerics"), 0, 50
    far = Case(50, "cases", "fhn", "start", key, 0.005, 12, entry, None)
    # From so far off its own step is too long for it in the first samples.
    assert record_truth(far).numerics > 6
    found = record_case(far, path)
    assert found.draws > 1 and found.case_truth.numerics < 6
    assert found.case.hidden["spread"] != 6.5
    loud = replace(far, noise=0.1)
    assert record_case(loud, path).draws == 1
    # Of a simulator that is too coarse just that is hidden.
    coarse = replace(far, kind="numerics")
    assert record_case(coarse, path).draws == 1
