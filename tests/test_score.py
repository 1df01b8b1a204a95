"""The scorer: errors against planted truths, and the files that it refuses."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
import pytest
import torch

from dashred import score
from dashred.config import load_config
from dashred.errors import InputError
from dashred.findings import freeze, write_json_atomic
from dashred.physics.system import System
from dashred.sealing import SealedTerm, Truth, open_seal, seal
from dashred.stages.verification import write_estimates

LAW = (SealedTerm("u", "u**3", -0.1), SealedTerm("u", "sin(u)", 0.2))


@pytest.fixture
def system(quick) -> System:
    config = load_config([f"conf={quick}"], entry="record")
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
    write_json_atomic(tmp_path / "findings.json", {"latent": latent})
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
    assert score.main(words(frozen)) == 0
    found = json.loads((frozen / "score.json").read_text())
    known = {name: value for name, value in found["field_rmse"].items() if value is not None}
    assert known == pytest.approx({"simulation": 2.0, "shred": 1.0, "dashred": 0.0})
    assert found["field_rmse"].keys() == set(score.METHODS)
    assert {"space_time_truth.png", "rmse_against_time.png"} <= {p.name for p in frozen.iterdir()}
    assert "2.000" in capsys.readouterr().out


def test_true_terms_get_the_rank_that_each_algorithm_gave_them(frozen) -> None:
    score.main(words(frozen))
    found = json.loads((frozen / "score.json").read_text())
    assert found["latent_rank"] == {"alg1": {"u: u**3": 2, "u: sin(u)": None}}


def test_what_is_not_frozen_is_not_scored(frozen, capsys) -> None:
    freeze(frozen, [])
    score.main(words(frozen))
    found = json.loads((frozen / "score.json").read_text())
    assert set(found["field_rmse"].values()) == {None}
    assert "no estimate" in capsys.readouterr().out


def test_the_truth_of_another_run_is_refused(frozen, system, truth) -> None:
    later = Truth("a", LAW, truth.times + 1, 2.0, truth.states)
    short = Truth("a", LAW, truth.times[:9], 2.0, truth.states[:9])
    for other in (later, short):
        seal(frozen / "sealed.nc", other, system)
        with pytest.raises(InputError, match="another recording"):
            score.main(words(frozen))
    coarse = Truth("a", LAW, truth.times, 2.0, truth.states[..., ::2])
    seal(frozen / "sealed.nc", coarse, system)
    with pytest.raises(InputError, match="another system"):
        score.main(words(frozen))
    assert not (frozen / "score.json").exists()


@pytest.mark.parametrize("content", [None, b"", b"no netcdf at all"])
def test_a_file_that_is_no_seal(frozen, content) -> None:
    (frozen / "sealed.nc").unlink()
    if content is not None:
        (frozen / "sealed.nc").write_bytes(content)
    with pytest.raises(InputError, match="cannot open the sealed truth") as caught:
        score.main(words(frozen))
    assert caught.value.where == str(frozen / "sealed.nc")


@pytest.mark.parametrize("given", [[], ["findings=x"], ["findings=x", "sealed=y", "truth=z"]])
def test_wrong_words(given) -> None:
    with pytest.raises(InputError, match="findings=DIR and sealed=FILE are needed"):
        score.main(given)
