"""Uncertain parameters: both ways of writing them, overrides, and one message for every error."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest

import dashred
from dashred.config import Config, config_sha256, frozen_input, load_config
from dashred.core.errors import InputError

TEXT = """\
system:
  title: capacitor
  fields: {q: charge}
  parameters:
    R: {value: 2.7, spread: 1.0}
    C:
      value: 1/2
      spread: 0.1*2
    m: 0.4
  let: {v: q/C}
  equations: {q: -v/R + m*q}
  start: {q: 1}
  integrator: {dt: 0.1}
recording: {path: my.csv}
"""
PLAIN = """\
  parameters: {R: 2.7, C: 0.5, m: 0.4}
  parameter_spread: {R: 1.0, C: 0.2}
"""
BEGIN, END = TEXT.index("  parameters:"), TEXT.index("  let:")
Load = Callable[..., Config]


@pytest.fixture
def load(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Load:
    """Write a configuration into an empty working directory; load it."""
    monkeypatch.chdir(tmp_path)

    def loaded(*words: str, text: str = TEXT) -> Config:
        Path("rc.yaml").write_text(text)
        return load_config(["conf=rc.yaml", *words], entry="train")

    return loaded


def test_both_ways_of_writing_a_spread_are_the_same(load: Load) -> None:
    short, plain = load(), load(text=TEXT[:BEGIN] + PLAIN + TEXT[END:])
    assert short.system.parameters == {"R": 2.7, "C": 0.5, "m": 0.4}
    assert short.system.parameter_spread == {"R": 1.0, "C": 0.2}
    assert list(short.system.parameters) == ["R", "C", "m"]
    assert config_sha256(short) == config_sha256(plain)
    assert short.where("system.parameters.C") == "rc.yaml:7"
    assert short.where("system.parameter_spread.C") == "rc.yaml:8"


def test_without_spreads_the_frozen_input_knows_of_none(load: Load) -> None:
    exact = load(text=TEXT[:BEGIN] + "  parameters: {R: 2.7, C: 0.5, m: 0.4}\n" + TEXT[END:])
    assert exact.system.parameter_spread == {}
    assert "parameter_spread" not in frozen_input(exact)["system"]
    assert frozen_input(load())["system"]["parameter_spread"] == {"R": 1.0, "C": 0.2}


OVERRIDES = [
    (["system.parameters.R=3"], 3.0, 1.0),
    (["system.parameters.R.value=3"], 3.0, 1.0),
    (["system.parameters.R.spread=0.5"], 2.7, 0.5),
    (["system.parameter_spread.R=1/2"], 2.7, 0.5),
    (["system.parameters.R={value: 3, spread: 2}"], 3.0, 2.0),
    (["system.parameters={R: {value: 3, spread: 2}}"], 3.0, 2.0),
    (["system.parameters.R={value: 3, spread: 2}", "system.parameters.R.value=4"], 4.0, 2.0),
    (["system.parameters.R={value: 3, spread: 2}", "system.parameters.R.spread=4"], 3.0, 4.0),
    (["system.parameters.R.spread=4", "system.parameters.R={value: 3, spread: 2}"], 3.0, 2.0),
]


@pytest.mark.parametrize(("words", "value", "spread"), OVERRIDES)
def test_the_command_line_overrides_values_and_spreads(
    load: Load, words: list[str], value: float, spread: float
) -> None:
    system = load(*words).system
    assert system.parameters == {"R": value, "C": 0.5, "m": 0.4}
    assert system.parameter_spread == {"R": spread, "C": 0.2}


def test_an_exact_parameter_gets_a_spread_and_an_uncertain_one_loses_it(load: Load) -> None:
    assert load("system.parameters.m.spread=0.3").system.parameter_spread["m"] == 0.3
    exact = load("system.parameters.R.spread=~", "system.parameter_spread.C=~")
    assert exact.system.parameter_spread == {} and exact.system.parameters["R"] == 2.7
    removed = load("system.parameters.R=~", "system.equations.q=-v + m*q")
    assert removed.system.parameters == {"C": 0.5, "m": 0.4}
    assert removed.system.parameter_spread == {"C": 0.2}
    assert not {"system.parameters.R", "system.parameter_spread.R"} & removed.lines.keys()


def test_a_dict_is_read_like_a_file() -> None:
    system: dict[str, Any] = {
        "title": "capacitor",
        "fields": {"q": "charge"},
        "parameters": {"R": {"value": 2.7, "spread": 1.0}, "m": 0.4},
        "equations": {"q": "-q/R + m*q"},
        "start": {"q": 1},
        "integrator": {"dt": 0.1},
    }
    config = dashred.Problem.from_dict({"system": system}).config
    assert config.system.parameter_spread == {"R": 1.0}
    nested = {
        "system.parameters": {"R": {"value": 3, "spread": 2}},
        "system.parameters.m.spread": 1,
    }
    config = dashred.Problem.from_dict({"system": system}, overrides=nested).config
    assert config.system.parameters == {"R": 3.0, "m": 0.4}
    assert config.system.parameter_spread == {"R": 2.0, "m": 1.0}
    twice = {"system.parameters.R": {"spread": 2}, "system.parameter_spread.R": 3}
    with pytest.raises(InputError, match=r"system\.parameter_spread\.R is given twice"):
        dashred.Problem.from_dict({"system": system}, overrides=twice)
    system["parameters"]["R"] = {"spread": 1.0}
    with pytest.raises(InputError, match=r"^dict, system\.parameters\.R: .* has no value"):
        dashred.Problem.from_dict({"system": system})


SPREAD = "spread: 1.0}"
AFTER = "    m: 0.4\n"
WRONG_FILES = [
    (SPREAD, "sprad: 1.0}", 5, "unknown key system.parameters.R.sprad", "did you mean spread?"),
    ("value: 2.7, ", "", 5, "system.parameters.R has no value", "R: {value: 2.7, spread: 1.0}"),
    ("{value: 2.7, spread: 1.0}", "{}", 5, "system.parameters.R must be a number", None),
    (SPREAD, "spread: 0}", 5, "the spread of R must be a positive number; got 0", "omit"),
    (SPREAD, "spread: -1}", 5, "the spread of R must be a positive number; got -1", "omit"),
    (SPREAD, "spread: 1e999}", 5, "system.parameter_spread.R must be finite; got inf", None),
    (SPREAD, "spread: wide}", 5, "system.parameter_spread.R must be a number", None),
    (SPREAD, "spread: }", 5, "system.parameter_spread.R must be a number; got nothing", None),
    (AFTER, f"{AFTER}  parameter_spread: {{R: 1}}\n", 5, "the spread of R is given twice", "one"),
    (AFTER, f"{AFTER}  parameter_spread: {{mm: 1}}\n", 10, "names mm, which is not a", "mean m?"),
    (AFTER, f"{AFTER}  parameter_spread: 1\n", 10, "system.parameter_spread must be a sec", None),
]  # fmt: skip


@pytest.mark.parametrize(("old", "new", "line", "what", "hint"), WRONG_FILES)
def test_a_wrong_file_is_refused_with_place_and_remedy(
    load: Load, old: str, new: str, line: int, what: str, hint: str | None
) -> None:
    assert TEXT.count(old) == 1
    with pytest.raises(InputError) as caught:
        load(text=TEXT.replace(old, new))
    assert caught.value.where == f"rc.yaml:{line}"
    assert what in caught.value.what
    assert hint is None or hint in (caught.value.hint or "")


WRONG_WORDS = [
    ("system.parameters.R.sprad=1", "unknown key system.parameters.R.sprad", "mean spread?"),
    ("system.parameters.R={valu: 1}", "unknown key system.parameters.R.valu", "mean value?"),
    ("system.parameters.mm.spread=1", "system.parameter_spread has no mm", "did you mean m?"),
    ("system.parameters.R.spread=-1", "the spread of R must be a positive number", "omit"),
    ("system.parameters.R.spread=wide", "system.parameter_spread.R must be a number", ""),
    ("system.parameters.R={}", "system.parameters.R must be a number", ""),
    ("system.parameters.m.spread=~", "system.parameter_spread has no m to remove", ""),
]


@pytest.mark.parametrize(("word", "what", "hint"), WRONG_WORDS)
def test_a_wrong_word_is_refused_with_a_remedy(load: Load, word: str, what: str, hint: str) -> None:
    with pytest.raises(InputError) as caught:
        load(word)
    assert caught.value.where == "command line"
    assert what in caught.value.what and hint in (caught.value.hint or "")


def test_snapshots_have_no_uncertain_parameters(load: Load) -> None:
    text = TEXT[: TEXT.index("  equations:")] + "  snapshots: runs.nc\nrecording: {path: my.csv}\n"
    with pytest.raises(InputError) as caught:
        load(text=text)
    assert "system.parameter_spread and system.snapshots are both given" in caught.value.what
    assert caught.value.where == "rc.yaml:5" and "remove it" in (caught.value.hint or "")


def test_snapshots_have_no_calibration(load: Load) -> None:
    text = TEXT[: TEXT.index("  parameters:")] + "  snapshots: runs.nc\nrecording: {path: my.csv}\n"
    with pytest.raises(InputError, match=r"recording\.calibration and system\.snapshots"):
        load("recording.calibration.q.gain=0.1", text=text)


def test_a_start_with_a_spread(load: Load) -> None:
    text = TEXT.replace("start: {q: 1}", "start: {q: {value: 1, spread: 0.1}}")
    config = load(text=text)
    assert config.system.start == {"q": 1} and config.system.spread == {"q": 0.1}
    assert load("system.start.q.spread=0.3", text=text).system.spread == {"q": 0.3}
    assert load("system.start.q={value: 2, spread: 0.2}").system.spread == {"q": 0.2}
    with pytest.raises(InputError, match=r"unknown key system\.start\.q\.sprad"):
        load(text=text.replace("spread: 0.1}", "sprad: 0.1}"))


PER = "R: {value: 2.7, spread: 1.0, per: episode}"


def test_a_value_per_episode(load: Load) -> None:
    text = TEXT.replace("R: {value: 2.7, spread: 1.0}", PER)
    assert load(text=text).system.parameter_per == {"R": "episode"}
    assert load("system.parameters.R.per=~", text=text).system.parameter_per == {}
    removed = load("system.parameters.R=~", "system.equations.q=-v + m*q", text=text)
    assert removed.system.parameter_per == {}
    for old, new, what in (
        ("per: episode", "per: subject", "only per: episode is possible"),
        ("spread: 1.0, per", "per", "R has a value per episode, but no spread"),
    ):
        with pytest.raises(InputError, match=what) as caught:
            load(text=text.replace(old, new))
        assert caught.value.where == "rc.yaml:5"
