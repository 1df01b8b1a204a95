"""A case is handed to the methods as files; what they have no answer to is told in one line."""

from __future__ import annotations

import json
from dataclasses import replace
from itertools import chain
from pathlib import Path

import numpy as np
import pytest

from dashred.core.errors import DONE, OUR_FAILURE
from dashred.evaluation.foreign.cases.case import (
    Case,
    LaterStates,
    MadeCase,
    Sensor,
    TrueTerm,
    Truth,
)
from dashred.evaluation.foreign.cases.case_files import read_simulator, write_case
from dashred.evaluation.foreign.peers.ask import ask_peers
from dashred.evaluation.foreign.peers.full_state import read_full_state, write_full_state
from dashred.evaluation.foreign.peers.measured import read_measured
from dashred.evaluation.foreign.peers.methods import (
    ASKED,
    ASKED_ABOUT_PAIRS,
    PEERS,
    asked_about,
    versions_of,
)
from dashred.evaluation.foreign.peers.run import main
from dashred.evaluation.foreign.peers.true_form import FORM, read_true_form, write_true_form

CASE = Case("dysts", "Oscillator", "term", 0, 0.01, 7)


def oscillator() -> MadeCase:
    """Return ``ẍ = −2x − 0.4ẋ`` measured in x; the simulator lacks the damping."""
    times = np.linspace(0, 8, 100)
    rate = np.sqrt(1.96)
    wave, decay = rate * times, np.exp(-0.2 * times)
    x = decay * (np.cos(wave) + 0.2 / rate * np.sin(wave))
    v = -decay * 2 / rate * np.sin(wave)
    states = np.stack([x, v], axis=1)
    noise = 0.01 * x.std() * np.random.default_rng(2).standard_normal((100, 1))
    hidden = np.stack([np.zeros(100), -0.4 * v], axis=1)
    return MadeCase(
        system={
            "title": "Oscillator",
            "fields": {"x": "position", "v": "velocity"},
            "equations": {"x": "v", "v": "-2*x"},
            "start": {"x": 1.02, "v": 0.03},
            "spread": {"x": 0.05, "v": 0.05},
            "integrator": {"method": "rk4", "dt": 0.02},
        },
        library={"v": ["1", "x", "v", "x**2", "v**2", "x**3"]},
        sensors=(Sensor("x", "x"),),
        readings=x[:, None] + noise,
        truth=Truth("term", "damping", times, states, hidden, (TrueTerm("v", "v", -0.4),)),
    )


@pytest.fixture
def folder(tmp_path: Path) -> Path:
    """Return the folder of the case, as a method finds it."""
    made = oscillator()
    write_case(tmp_path, made)
    write_full_state(tmp_path, made.truth, CASE.noise, 3)
    write_true_form(tmp_path, made.truth)
    return tmp_path


def test_the_files_hold_the_readings_and_the_form_without_coefficients(folder: Path) -> None:
    made, given = oscillator(), read_measured(folder)
    np.testing.assert_allclose(given.readings, made.readings, rtol=1e-6)
    np.testing.assert_allclose(given.noise, [0.01 * made.truth.states[:, 0].std()])
    assert given.columns == [0] and given.start.tolist() == [1.02, 0.03]
    assert "0.4" not in (folder / FORM).read_text()
    [term] = read_true_form(folder, given.system)
    assert (term.equation, str(term)) == ("v", "v")


def test_a_term_of_several_products_has_one_coefficient(folder: Path) -> None:
    truth = replace(oscillator().truth, terms=(TrueTerm("v", "(x - v)*v", 2.0, 2),))
    write_true_form(folder, truth)
    [term] = read_true_form(folder, read_simulator(folder))
    assert term.equation == "v"


@pytest.mark.parametrize("method", ["oracle", "joint_full"])
def test_a_method_writes_its_law(folder: Path, method: str) -> None:
    assert main([method, str(folder)]) == DONE
    [term] = json.loads((folder / f"{method}.json").read_text())["terms"]
    assert (term["equation"], term["term"]) == ("v", "v")
    assert term["coefficient"] == pytest.approx(-0.4, rel=0.05)


def test_later_states_are_stored(tmp_path: Path) -> None:
    made = oscillator()
    write_case(tmp_path, made)
    later = LaterStates(0.1, made.truth.states[:-1] + 1)
    write_full_state(tmp_path, replace(made.truth, later=later), CASE.noise, 3)
    full = read_full_state(tmp_path)
    assert full.later is not None and full.later.interval == 0.1
    np.testing.assert_array_equal(full.later.states, later.states)


def test_no_answer_is_one_line(folder: Path, capsys: pytest.CaptureFixture[str]) -> None:
    write_true_form(folder, replace(oscillator().truth, terms=(TrueTerm("v", "1", 1.0),)))
    assert main(["oracle", str(folder)]) == OUR_FAILURE
    said = capsys.readouterr().err.strip()
    assert "times the variance of the noise" in said and "\n" not in said
    (folder / FORM).unlink()
    assert main(["oracle", str(folder)]) == OUR_FAILURE
    assert capsys.readouterr().err.startswith("FileNotFoundError: ")


def test_the_method_that_is_told_the_form_is_asked_only_where_there_is_one() -> None:
    truth = oscillator().truth
    assert "oracle" in asked_about(0, truth)
    assert "oracle" not in asked_about(0, replace(truth, kind="nothing", terms=()))
    assert {*chain.from_iterable(ASKED.values()), *ASKED_ABOUT_PAIRS} == set(PEERS)
    assert versions_of("oracle").keys() == {"scipy"}


def test_methods_for_pairs_are_asked_only_where_there_are_pairs() -> None:
    truth = oscillator().truth
    pairs = replace(truth, later=LaterStates(0.1, truth.states[:-1]))
    assert asked_about(1, pairs) == (*asked_about(1, truth), *ASKED_ABOUT_PAIRS)


@pytest.mark.slow
def test_every_method_is_a_row_with_its_versions() -> None:
    rows = ask_peers(CASE, oscillator(), 60)
    assert list(rows) == list(ASKED[0])
    assert rows["oracle"]["right"] and rows["joint_full"]["right"], rows
    for name, row in rows.items():
        assert row["versions"].keys() == set(PEERS[name].packages)
        assert row["problem"] is None or "Traceback" not in row["problem"]
