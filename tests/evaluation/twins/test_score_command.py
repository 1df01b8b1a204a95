"""The scorer: errors against planted truths, and the files that it refuses."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import torch

from dashred.config import frozen_input, load_config
from dashred.core.errors import InputError
from dashred.core.findings.findings import freeze, write_json_atomic
from dashred.evaluation.twins import cause_scoring, score_command, scoring
from dashred.evaluation.twins.sealing import SealedTerm, Truth, open_seal, seal
from dashred.physics.system import System
from dashred.pipeline.outputs.field_files import write_estimates

FORECASTS = ("simulation_same_start", "simulation_refit", "corrected")
OLD_FORECASTS = ("before", "before_refit", "after")
LAW = (SealedTerm("u", "u**3", -0.1), SealedTerm("u", "sin(u)", 0.2))


INPUT = {"input": {"config": {"system": {"front": None}}}}


@pytest.fixture
def config(quick):
    return load_config([f"conf={quick}"], entry="record")


@pytest.fixture
def system(config) -> System:
    return System(config.system, config.where)


@pytest.fixture
def truth() -> Truth:
    times = torch.arange(31, dtype=torch.float64) / 10
    states = torch.from_numpy(np.random.default_rng(0).normal(3.0, 2.0, (31, 1, 32)))
    return Truth("a", LAW, times, 2.0, states)


@pytest.fixture
def frozen(tmp_path, system, truth) -> Path:
    """Findings with estimates that are 0, 1 and 2 std off the truth, and the sealed truth."""
    proposals = [{"equation": "u", "term": t, "rank": r} for r, t in enumerate(("u", "u**3"), 1)]
    latent = {"alg1": {"proposals": proposals}, "alg2": None}
    write_json_atomic(tmp_path / "findings.json", {**INPUT, "latent": latent})
    real, times = truth.states[:17], truth.times[:17]
    std = float(real.numpy().std())
    offsets = {"simulation": 2 * std, "shred": -std, "dashred": 0.0}
    fields = {name: real + offset for name, offset in offsets.items()}
    write_estimates(tmp_path / "estimates.nc", system, times, fields)
    freeze(tmp_path, ["estimates.nc"])
    seal(tmp_path / "sealed.nc", truth, system)
    return tmp_path


def words(folder: Path) -> list[str]:
    return [f"findings={folder}", f"sealed={folder / 'sealed.nc'}"]


def test_a_seal_gives_back_what_was_sealed(frozen, truth) -> None:
    opened, fields = open_seal(frozen / "sealed.nc")
    assert fields == ("u",)
    assert (opened.twin, opened.terms, opened.duration) == ("a", LAW, 2.0)
    assert torch.equal(opened.states, truth.states) and torch.equal(opened.times, truth.times)


def test_errors_are_in_units_of_the_true_fields_std(frozen, capsys) -> None:
    assert score_command.main(words(frozen)) == 0
    found = json.loads((frozen / "score.json").read_text())
    known = {name: value for name, value in found["field_rmse"].items() if value is not None}
    assert known == pytest.approx({"simulation": 2.0, "shred": 1.0, "dashred": 0.0})
    assert found["field_rmse"].keys() == set(scoring.METHODS)
    assert {"space_time_truth.png", "rmse_against_time.png"} <= {p.name for p in frozen.iterdir()}
    assert "2.000" in capsys.readouterr().out


def test_true_terms_get_the_rank_that_each_algorithm_gave_them(frozen) -> None:
    score_command.main(words(frozen))
    found = json.loads((frozen / "score.json").read_text())
    assert found["latent_rank"] == {"alg1": {"u: u**3": 2, "u: sin(u)": None}}


def test_what_is_not_frozen_is_not_scored(frozen, capsys) -> None:
    freeze(frozen, [])
    score_command.main(words(frozen))
    found = json.loads((frozen / "score.json").read_text())
    assert set(found["field_rmse"].values()) == {None}
    assert "no estimate" in capsys.readouterr().out


def test_the_truth_of_another_run_is_refused(frozen, quick, system, truth) -> None:
    later = Truth("a", LAW, truth.times + 1, 2.0, truth.states)
    short = Truth("a", LAW, truth.times[:9], 2.0, truth.states[:9])
    for other in (later, short):
        seal(frozen / "sealed.nc", other, system)
        with pytest.raises(InputError, match="another recording"):
            score_command.main(words(frozen))
    coarse = Truth("a", LAW, truth.times, 2.0, truth.states[..., ::2])
    fewer = load_config([f"conf={quick}", "system.axes.x.points=16"], entry="record")
    seal(frozen / "sealed.nc", coarse, System(fewer.system, fewer.where))
    with pytest.raises(InputError, match="another system"):
        score_command.main(words(frozen))
    assert not (frozen / "score.json").exists()


@pytest.mark.parametrize("content", [None, b"", b"no netcdf at all"])
def test_a_file_that_is_no_seal(frozen, content) -> None:
    (frozen / "sealed.nc").unlink()
    if content is not None:
        (frozen / "sealed.nc").write_bytes(content)
    with pytest.raises(InputError, match="cannot open the sealed truth") as caught:
        score_command.main(words(frozen))
    assert caught.value.where == str(frozen / "sealed.nc")


@pytest.mark.parametrize(
    ("given", "message"),
    [
        ([], "findings= and sealed= are missing"),
        (["findings=x"], "sealed= is missing"),
        (["findings=x", "sealed=y", "truth=z"], "unknown key truth"),
    ],
)
def test_wrong_arguments_are_refused(given, message) -> None:
    with pytest.raises(InputError, match=message):
        score_command.main(given)


# --- the law -------------------------------------------------------------------------------------


def entry(equation: str | None, term: str, coefficient: float, **more: object) -> dict[str, Any]:
    return {"equation": equation, "term": term, "coefficient": coefficient, "std": 0.01} | more


def new_value(name: str, before: float, to: float) -> dict[str, Any]:
    return {"equation": None, "parameter": name, "term": name, "from": before, "to": to}


def scored(config, terms: list[dict[str, Any]] | None, *truth: SealedTerm):
    findings = {"terms": terms, "input": {"config": frozen_input(config)}}
    return scoring.score_law(json.loads(json.dumps(findings)), truth)


CUBIC, SINE = SealedTerm("u", "u**3", -0.1), SealedTerm("u", "sin(u)", 0.2)
FOUND = [entry("u", "sin(u)", 0.19), entry("u", "u*u*u", -0.101)]


def test_the_true_terms_in_any_order_and_spelling_are_the_exact_support(config) -> None:
    assert scored(config, FOUND, CUBIC, SINE) == (True, pytest.approx(0.05))
    whole = SealedTerm("u", "2*sin(u) - u**3", 0.1)
    assert scored(config, FOUND, whole) == (True, pytest.approx(0.05))


@pytest.mark.parametrize(
    "terms",
    [
        [],
        FOUND[:1],
        [*FOUND, entry("u", "u", 0.001)],
        [FOUND[0], entry("u", "u**2", -0.1)],
        [FOUND[0], FOUND[1] | {"region": [{"axis": "x", "from": 0, "to": 1}]}],
        [*FOUND, new_value("nu", 0.2, 0.21)],
    ],
)
def test_any_other_set_is_not(config, terms) -> None:
    assert scored(config, terms, CUBIC, SINE) == (False, None)


def test_a_term_of_another_equation_is_another_term() -> None:
    config = load_config(["conf=rde"], entry="record")
    truth = SealedTerm("lam", "lam", -0.08)
    assert scored(config, [entry("lam", "lam", -0.08)], truth) == (True, pytest.approx(0))
    assert scored(config, [entry("u", "lam", -0.08)], truth) == (False, None)


def test_where_nothing_is_hidden_no_term_is_exact(config) -> None:
    assert scored(config, []) == (True, 0.0)
    assert scored(config, FOUND) == (False, None)
    assert scored(config, [new_value("nu", 0.2, 0.21)]) == (False, None)
    assert scored(config, None) == (None, None)


REGION = ("x", 1.0, 3.0, 0.1)
LOCAL = SealedTerm("u", "u**3", -0.1, REGION)


def found_in(*region: dict[str, Any]) -> list[dict[str, Any]]:
    return [entry("u", "u**3", -0.11, region=list(region))]


def test_a_term_in_a_region_is_exact_in_a_region_of_that_kind_alone(config) -> None:
    there = found_in({"axis": "x", "from": 1.5, "to": 3.5, "std": 0.1})
    assert scored(config, there, LOCAL) == (True, pytest.approx(0.1))
    assert scored(config, [entry("u", "u**3", -0.1)], LOCAL) == (False, None)
    assert scored(config, found_in({"axis": "t", "from": 1.0, "std": 0.1}), LOCAL) == (False, None)
    gate = SealedTerm("u", "u**3", -0.1, ("u", None, 0.4, 0.1))
    assert scored(config, found_in({"field": "u", "below": 0.4, "std": 0.1}), gate)[0] is True
    assert scored(config, found_in({"field": "u", "above": 0.4, "std": 0.1}), gate)[0] is False


def test_how_well_a_region_was_found(config) -> None:
    def region(terms: list[dict[str, Any]], *truth: SealedTerm):
        findings = {"terms": terms, "input": {"config": frozen_input(config)}}
        return cause_scoring.score_region(json.loads(json.dumps(findings)), truth)

    there = found_in({"axis": "x", "from": 1.5, "to": 3.5, "std": 0.1})
    assert region(there, LOCAL) == {
        "overlap": pytest.approx(1.5 / 2.5), "onset": None, "threshold": None
    }  # fmt: skip
    # On a ring a region is the same a turn further on.
    turned = found_in({"axis": "x", "from": 1.0 - 2 * np.pi, "to": 3.0 - 2 * np.pi, "std": 0.1})
    assert region(turned, LOCAL)["overlap"] == pytest.approx(1.0)
    # A region that wraps around the ring ends before it begins.
    around = found_in({"axis": "x", "from": 3.0, "to": 1.0, "std": 0.1})
    assert region(around, LOCAL)["overlap"] == pytest.approx(0.0)
    apart = found_in({"axis": "x", "from": 4.0, "to": 5.0, "std": 0.1})
    assert region(apart, LOCAL)["overlap"] == 0.0
    later = SealedTerm("u", "u**3", -0.1, ("t", 2.0, None, 0.1))
    assert region(found_in({"axis": "t", "from": 2.3, "std": 0.1}), later)[
        "onset"
    ] == pytest.approx(0.3)
    gate = SealedTerm("u", "u**3", -0.1, ("u", None, 0.4, 0.1))
    below = found_in({"field": "u", "below": 0.5, "std": 0.1})
    assert region(below, gate)["threshold"] == pytest.approx(0.1)
    assert region(there, gate) == {"overlap": None, "onset": None, "threshold": None}
    assert region(FOUND, CUBIC, SINE) is None


def test_a_parameter_is_the_terms_that_its_new_value_adds() -> None:
    config = load_config(["conf=rde"], entry="record")
    damping = SealedTerm("u", "u**2", -0.04)
    found = scored(config, [new_value("eps", 0.28, 0.321)], damping)
    assert found == (True, pytest.approx(0.025))
    viscosity = [SealedTerm("u", "lap(u)", 0.01), SealedTerm("lam", "lap(lam)", 0.01)]
    assert scored(config, [new_value("nu", 0.035, 0.045)], *viscosity)[0] is True
    assert scored(config, [new_value("nu", 0.035, 0.045)], viscosity[0]) == (False, None)
    assert scored(config, [new_value("r", 5, 5.5)], damping) == (False, None)
    both = [new_value("eps", 0.28, 0.32), entry("u", "u", 0.1)]
    assert scored(config, both, damping, SealedTerm("u", "u", 0.1))[0] is True


# --- fields --------------------------------------------------------------------------------------


@pytest.fixture
def no_figures(monkeypatch) -> None:
    monkeypatch.setattr("dashred.evaluation.twins.truth_figures.draw_truth", lambda *_: [])


def test_each_field_is_scored_by_itself_too(no_figures, tmp_path) -> None:
    config = load_config(["conf=pendulum"], entry="record")
    system = System(config.system, config.where)
    times = torch.arange(16, dtype=torch.float64) / 10
    states = torch.from_numpy(np.random.default_rng(0).normal(0, [1.0, 5.0], (16, 2)))
    seal(tmp_path / "sealed.nc", Truth("a", (), times, 1.0, states), system)
    std = states[:11].std(dim=0, correction=0)
    off = {"corrected": states[:11] + std * torch.tensor([0.3, 0.4])}
    write_estimates(tmp_path / "estimates.nc", system, times[:11], off)
    write_json_atomic(tmp_path / "findings.json", {**INPUT, "latent": {}, "terms": None})
    freeze(tmp_path, ["estimates.nc"])
    score_command.main(words(tmp_path))
    found = json.loads((tmp_path / "score.json").read_text())
    first, second = system.fields
    assert found["field_rmse_by_field"][first] == pytest.approx({"corrected": 0.3})
    assert found["field_rmse_by_field"][second] == pytest.approx({"corrected": 0.4})
    assert found["field_rmse"]["corrected"] == pytest.approx(np.sqrt(0.125))
    assert found["forecast"] == dict.fromkeys([*FORECASTS, *OLD_FORECASTS])


def forecast_of(frozen: Path, system: System, times: torch.Tensor, real: torch.Tensor) -> None:
    std = float(real.numpy().std())
    offsets = {"simulation_same_start": 2.0, "simulation_refit": 1.0, "corrected": 0.5}
    fields = {name: real + offset * std for name, offset in offsets.items()}
    write_estimates(frozen / "forecast.nc", system, times, fields)
    freeze(frozen, ["estimates.nc", "forecast.nc"])


def test_forecasts_are_compared_with_the_truth_of_their_own_times(
    no_figures, frozen, system, truth, capsys
) -> None:
    late = truth.times > truth.duration
    # An analysis counts its times in its own way: they differ by a rounding.
    forecast_of(frozen, system, truth.times[late] * (1 + 1e-15), truth.states[late])
    assert score_command.main(words(frozen)) == 0
    found = json.loads((frozen / "score.json").read_text())
    for names in (FORECASTS, OLD_FORECASTS):
        assert [found["forecast"][name] for name in names] == pytest.approx([2.0, 1.0, 0.5])
    assert found["field_rmse"]["simulation"] == pytest.approx(2.0)
    assert "Forecast RMSE after the end of the recording" in capsys.readouterr().out


def test_a_forecast_is_no_forecast_within_the_recording(no_figures, frozen, system, truth) -> None:
    forecast_of(frozen, system, truth.times[15:], truth.states[15:])
    with pytest.raises(ValueError, match="into the recording"):
        score_command.main(words(frozen))


def test_what_is_known_is_logged(no_figures, frozen, system, truth, capsys) -> None:
    forecast_of(frozen, system, truth.times[21:], truth.states[21:])
    found = score_command.score_findings(frozen, frozen / "sealed.nc")[0]
    assert score_command.metrics(found).keys() == {
        *(f"score/{method}" for method in ("simulation", "shred", "dashred")),
        *(f"score/forecast/{name}" for name in (*FORECASTS, *OLD_FORECASTS)),
    }
    found |= {"exact_support": True, "coefficient_error": 0.02}
    logged = score_command.metrics(found)
    assert (logged["score/exact_support"], logged["score/coefficient_error"]) == (1.0, 0.02)
    score_command._print_score(found)
    assert (
        "The law found is the true law, with coefficients within 2.0 %." in capsys.readouterr().out
    )
