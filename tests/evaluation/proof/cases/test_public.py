"""The public set: its recordings can be analysed, its truths can be checked and not be read."""

from __future__ import annotations

import json
from pathlib import Path

import pytest

from dashred.config import load_config
from dashred.core.errors import InputError
from dashred.evaluation.proof.cases.public import HASHES, check, publish, select_cases
from dashred.pipeline.input.build_problem import build_problem

CHECKOUT = Path(__file__).resolve().parents[4]
PUBLIC = CHECKOUT / "conf" / "proof"
NAMES = sorted(json.loads((PUBLIC / HASHES).read_text()))


@pytest.fixture(scope="module")
def published(tmp_path_factory: pytest.TempPathFactory) -> tuple[Path, Path]:
    folder = tmp_path_factory.mktemp("public")
    cases = [case for case in select_cases("secret", 4) if case.system == "fhn"][:1]
    publish(cases, folder, folder / "truths.json")
    return folder, folder / "truths.json"


def test_a_truth_is_known_by_its_hash(published, tmp_path) -> None:
    folder, truths = published
    assert check(folder, truths) == {"fhn-1": True}
    claimed = json.loads(truths.read_text())
    claimed["fhn-1"]["kind"] = "something else"
    (tmp_path / "claimed.json").write_text(json.dumps(claimed))
    assert check(folder, tmp_path / "claimed.json") == {"fhn-1": False}
    (tmp_path / "claimed.json").write_text(json.dumps({"fhn-9": claimed["fhn-1"]}))
    with pytest.raises(InputError):
        check(folder, tmp_path / "claimed.json")


def test_nothing_published_says_what_was_hidden(published) -> None:
    folder, truths = published
    [told] = json.loads(truths.read_text()).values()
    public = [p for p in folder.iterdir() if p != truths]
    assert len(public) == 4
    texts = "".join(path.read_text() for path in public)
    assert told["salt"] not in texts and told["hidden"] not in texts


def test_the_same_secret_chooses_the_same_and_no_order_tells_the_kinds() -> None:
    assert select_cases("secret", 10) == select_cases("secret", 10)
    kinds = {tuple(case.kind for case in select_cases(f"secret {j}", 10)) for j in range(5)}
    assert len(kinds) == 5


@pytest.mark.parametrize("name", NAMES)
def test_every_public_case_can_be_analysed(name) -> None:
    problem = build_problem(load_config([f"conf={PUBLIC / name}.yaml"], entry="train"))
    assert len(problem.times) > 50 and problem.split.test


def test_there_are_cases_of_every_system() -> None:
    assert len(NAMES) >= 8
    assert {name.partition("-")[0] for name in NAMES} == {"fhn", "ks1d", "rde"}
