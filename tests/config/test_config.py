"""Configuration: layers, types, locations, and one clear message for every input error."""

from __future__ import annotations

import dataclasses
import math
import subprocess
import sys
from pathlib import Path
from typing import Any, get_type_hints

import pytest
import yaml
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

from dashred.config import Config, Settings, config_sha256, frozen_input, load_config, usage
from dashred.config.bundled_systems import BASE, CONF, bundled_names
from dashred.config.layers import prepare
from dashred.config.source import Source, read_text
from dashred.core.errors import InputError

SYSTEM = """\
system:
  title: A wave that dies
  axes: {x: {length: 2*pi, points: 64}}
  fields: {u: height, v: speed}
  parameters: {c: 1.0, nu: 1e-2}
  let: {drag: nu*v}
  equations:
    u: v
    v: c**2*d(u, x, 2) - drag
  start: {u: sin(x), v: 0}
  spread: {u: 10%, v: 0.05}
  integrator: {dt: 0.1/15}
recording:
  twin: a
  every: 0.1
"""


@pytest.fixture
def write(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Any:
    """Write a system's file into an empty working directory; return its loader."""
    monkeypatch.chdir(tmp_path)

    def load(*words: str, text: str = SYSTEM, entry: str = "train") -> Config:
        Path("wave.yaml").write_text(text, encoding="utf-8")
        return load_config(["conf=wave.yaml", *words], entry=entry)

    return load


def refused(load: Any, *words: str, text: str = SYSTEM) -> InputError:
    with pytest.raises(InputError) as caught:
        load(*words, text=text)
    return caught.value


def swapped(old: str, new: str) -> str:
    assert SYSTEM.count(old) == 1
    return SYSTEM.replace(old, new)


# --- valid configurations ------------------------------------------------------------------------


def test_layers_override_one_another(write: Any) -> None:
    config = write("shred.lags=30", "recording.noise=1e-2")
    assert config.shred.lags == 30  # command line
    assert config.recording.every == 0.1  # file
    assert config.shred.layers == yaml.safe_load(BASE.read_text())["shred"]["layers"]  # defaults
    assert config.recording.noise == 0.01
    assert (config.name, config.source.name) == ("wave", "wave.yaml")


def test_numbers_may_be_arithmetic_and_scientific(write: Any) -> None:
    config = write("recording.duration=3*pi", "shred.rate=1e-4")
    assert config.system.axes["x"].length == 2 * math.pi
    assert config.system.integrator.dt == 0.1 / 15
    assert config.system.parameters == {"c": 1.0, "nu": 0.01}
    assert config.recording.duration == pytest.approx(3 * math.pi)
    assert config.shred.rate == 1e-4


def test_the_result_is_plain_python(write: Any) -> None:
    def plain(value: Any) -> bool:
        if isinstance(value, dict):
            return type(value) is dict and all(map(plain, value.values()))
        if isinstance(value, list):
            return type(value) is list and all(map(plain, value))
        return value is None or type(value) in (str, int, float, bool)

    assert plain(frozen_input(write()))


def test_texts_on_the_command_line_are_taken_literally(write: Any) -> None:
    config = write("system.title=a: b # c", "tracking.run=12e45", "system.equations.u=-2*d(u, x)")
    assert config.system.title == "a: b # c"
    assert config.tracking.run == "12e45"
    assert config.system.equations["u"] == "-2*d(u, x)"
    assert write('system.title="a b"').system.title == "a b"
    assert write("output=").output is None


def test_a_library_holds_texts(write: Any) -> None:
    config = write('library.u=[1, u**2, "d(u, x)"]')
    assert config.library == {"u": ["1", "u**2", "d(u, x)"]}


def test_a_later_word_wins(write: Any) -> None:
    assert write("seed=1", "seed=2").seed == 2


def test_an_entry_is_removed_on_the_command_line(write: Any) -> None:
    removed = [f"system.{key}=~" for key in ("parameters.nu", "let.drag", "spread.v")]
    config = write(*removed, "system.equations.v=c**2*d(u, x, 2)")
    assert config.system.parameters == {"c": 1.0}
    assert config.system.let == {}
    assert "v" not in config.system.spread
    with pytest.raises(InputError, match=r"system.parameters has no mu to remove.*\n.*nu"):
        write("system.parameters.mu=~")
    with pytest.raises(InputError, match="nu"):
        write("system.parameters.nu=~")


@pytest.mark.parametrize("words", [["recording.twin=null"], ["recording.twin="]])
def test_the_null_twin_is_a_name(write: Any, words: list[str]) -> None:
    assert write(*words).recording.twin == "null"


@pytest.mark.parametrize("written", ["twin: null", "twin:", "twin: 'null'", "twin: ~"])
def test_the_null_twin_is_a_name_in_yaml_too(write: Any, written: str) -> None:
    assert write(text=swapped("twin: a", written)).recording.twin == "null"


def test_an_own_recording_drops_the_twin_and_the_other_way_round(write: Any) -> None:
    config = write("recording.path=my.csv")
    assert (config.recording.twin, Path(config.recording.path).name) == (None, "my.csv")
    own = swapped("twin: a", "path: my.csv")
    assert write("recording.twin=b", text=own).recording.path is None
    assert write("recording.twin=b", text=own).recording.twin == "b"


def test_both_recordings_in_one_layer_are_refused(write: Any) -> None:
    error = refused(write, "recording.twin=a", "recording.path=my.csv")
    assert "both given" in error.what
    error = refused(write, text=swapped("twin: a", "twin: a\n  path: my.csv"))
    assert error.where == "wave.yaml:15"


def test_paths_count_from_the_place_that_wrote_them(
    write: Any, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    (tmp_path / "sub").mkdir()
    text = swapped("twin: a", "path: my.csv")
    (tmp_path / "sub" / "own.yaml").write_text(text)
    config = load_config(["conf=sub/own.yaml", "output=out"], entry="train")
    assert config.recording.path == str(tmp_path / "sub" / "my.csv")
    assert config.output == str(tmp_path / "out")
    assert config.tracking.root == str(CONF.parent / "mlruns")
    monkeypatch.setattr("dashred.config.bundled_systems.IS_INSTALLED", True)
    config = load_config(["conf=sub/own.yaml", "output=out"], entry="train")
    assert config.tracking.root == str(tmp_path / "mlruns")


def test_sensors_read_every_field_unless_said_otherwise(write: Any) -> None:
    assert write().recording.reads == ["u", "v"]
    assert write("recording.reads=[drag]").recording.reads == ["drag"]


def test_the_recorder_takes_twin_for_short(write: Any) -> None:
    assert write("twin=b", entry="record").recording.twin == "b"
    assert "unknown key twin" in refused(write, "twin=b").what


def test_where_points_at_the_line_or_the_section_around(write: Any) -> None:
    config = write("seed=3", "system.axes={x: {points: 32}}")
    assert config.where("system.equations.v") == "wave.yaml:9"
    assert config.where("system.equations.w") == "wave.yaml:7"
    assert config.where("system.axes.x.points") == "command line"
    assert config.where("seed") == "command line"
    assert config.where("shred.lags").startswith("conf/base.yaml:")
    assert config.where("library.u[2]").startswith("conf/base.yaml:")
    assert config.where("nowhere") == "wave.yaml"


@pytest.mark.parametrize("name", bundled_names())
def test_bundled_systems_load(name: str) -> None:
    config = load_config([f"conf={name}"], entry="train")
    assert config.name == name
    assert config.where("system.title").startswith(f"conf/{name}.yaml:")


def test_every_default_is_in_base_yaml() -> None:
    def unset(kind: Any, values: dict[str, Any], parent: str = "") -> set[str]:
        keys: set[str] = set()
        for name, member in get_type_hints(kind).items():
            if name not in values:
                keys.add(parent + name)
            elif dataclasses.is_dataclass(member):
                keys |= unset(member, values[name], f"{parent}{name}.")
        return keys

    declared = {f"system.{f.name}" for f in dataclasses.fields(get_type_hints(Settings)["system"])}
    declared -= {"system.integrator"}
    own = declared | {"recording.twin", "recording.path"}
    assert unset(Settings, yaml.safe_load(BASE.read_text())) == own


# --- frozen input --------------------------------------------------------------------------------


def test_the_hash_changes_with_the_findings_input_alone(write: Any) -> None:
    same = config_sha256(write("recording.path=my.csv"))
    assert same == config_sha256(write("recording.path=../other/my.csv", "output=there"))
    assert same == config_sha256(write("recording.path=my.csv", "tracking.root=elsewhere"))
    assert same != config_sha256(write("recording.path=my.csv", "seed=1"))
    assert same != config_sha256(write("recording.path=my.csv", "system.parameters.c=1.1"))


# --- invalid input -------------------------------------------------------------------------------

UNKNOWN = [
    ("shred.lag=3", "unknown key shred.lag", "did you mean shred.lags?"),
    ("sed=3", "unknown key sed", "did you mean seed?"),
    ("lags=3", "unknown key lags", "did you mean shred.lags?"),
    ("system.axes.x.point=32", "unknown key system.axes.x.point", "system.axes.x.points?"),
    ("system.parameters.nuu=0.1", "system.parameters has no nuu", "did you mean nu?"),
    ("system.equations.w=u", "system.equations has no w", "one of: u, v"),
    ("system.spread.w=0.1", "system.spread has no w", "one of: u, v"),
    ("seed.deep=1", "unknown key seed.deep: seed is a whole number", None),
    ("library.w=[u]", "names w, which is neither", "one of: u, v"),
    ("recording.reads=[w, u]", "recording.reads names w", "one of: u, v, drag"),
    ("=3", "expected key=value, got '=3'", "see --help"),
    ("seed", "expected key=value, got 'seed'", "see --help"),
    ("--seed=3", "expected key=value, got '--seed=3'", "write seed=3"),
    (".=3", "unknown key ", None),
    ("shred..lags=3", "unknown key shred.", None),
    ("shred=3", "shred must be a section of keys; got 3", None),
]


@pytest.mark.parametrize(("word", "what", "hint"), UNKNOWN)
def test_unknown_words(write: Any, word: str, what: str, hint: str | None) -> None:
    error = refused(write, word)
    assert what in error.what
    assert error.where == "command line"
    assert hint is None or hint in (error.hint or "")


WRONG_VALUES = [
    ("shred.lags=abc", "shred.lags must be a whole number; got 'abc'"),
    ("shred.lags=2.5", "shred.lags must be a whole number; got 2.5"),
    ("shred.lags=true", "shred.lags must be a whole number; got True"),
    ("shred.lags=", "shred.lags must be a whole number; got nothing"),
    ("shred.lags=0", "shred.lags must be at least 1 and at most 1000000; got 0"),
    ("shred.lags=1_0", "shred.lags must be a whole number; got '1_0'"),
    ("threads=10000000", "threads must be at least 1 and at most 1000000; got 1e+07"),
    ("seed=4294967296", "seed must be at least 0 and below 4294967296"),
    ("system.integrator.dealias=yes", "dealias must be true or false; got 'yes'"),
    ("system.integrator.dt=1e-300", "too many steps"),
    ("system.start.u=1e999", "system.start.u must be finite; got inf"),
    ("seed[0]=1", "unknown key seed[0]"),
    ("output=~nobody-here/x", "there is no home folder for '~nobody-here/x'"),
    ('output="a\\0b"', "the character '\\x00' is not allowed in a text"),
    ("system.title=\udcff", "the character '\\udcff' is not allowed in a text"),
    ("shred.lags=99999999999999999999", "shred.lags must be a whole number; got 1e+20"),
    ("shred.rate=0", "shred.rate must be above 0; got 0"),
    ("shred.rate=.inf", "shred.rate must be a number: "),
    ("shred.rate=1e999", "shred.rate must be finite; got inf"),
    ("shred.rate=true", "shred.rate must be a number; got True"),
    ("shred.rate=[1]", "shred.rate must be a number; got a list"),
    ("shred.rate=fast", "shred.rate must be a number: "),
    ("shred.decoder=3", "shred.decoder must be a list, such as [a, b], or null; got 3"),
    ("budget=0", "budget must be above 0; got 0"),
    ("budget=-5", "budget must be above 0; got -5"),
    ("shred.decoder=[]", "shred.decoder is empty"),
    ("shred.decoder=[8, big]", "shred.decoder[1] must be a whole number; got 'big'"),
    ("shred.decoder=[8, 0]", "shred.decoder[1] must be at least 1 and at most 1000000"),
    ("latent_sindy.steps=[]", "latent_sindy.steps is empty"),
    ("simulation.discrepancy=maybe", "simulation.discrepancy must be true or false; got 'maybe'"),
    ("simulation.held_out=192", "leaves no members to train on"),
    ("splits.time.test=0.9", "splits.time.test must be above 0 and below 0.9; got 0.9"),
    ("splits.time.test=0", "splits.time.test must be above 0 and below 0.9; got 0"),
    ("splits.sensors.test=-1", "splits.sensors.test must be a number, at least 0, or a list"),
    ("splits.sensors.test=[s1, s1]", "sensor 's1' is held out twice"),
    ("splits.sensors.extra=12", "leaves no sensors for SHRED's input"),
    ("recording.noise=-0.1", "recording.noise must be at least 0; got -0.1"),
    ("recording.sensors=0", "recording.sensors must be a number, at least 1"),
    ("recording.sensors=true", "recording.sensors must be a number, at least 1"),
    ("system.front=w", "system.front names w, which is not a field"),
    ("recording.every=null", "a twin needs recording.every"),
    ("recording.every=11", "a twin needs recording.every"),
    ("recording.twin=../a", "'../a' is not the name of a twin"),
    ("device=gpu", "unknown device 'gpu'"),
    ("cluster=10.0.0.5:8786", "'10.0.0.5:8786' does not name a cluster"),
    ("cluster=0", "0 is not a number of workers from 1 to 1024"),
    (
        "system.axes.x.points=7",
        "system.axes.x.points must be at least 8 and at most 1000000; got 7",
    ),
    ("system.axes.x.length=-1", "system.axes.x.length must be above 0; got -1"),
    ("system.integrator.dt=0", "system.integrator.dt must be above 0; got 0"),
    ("system.integrator.dt=0.1/0", "0.1/0"),
    ("system.integrator.space=cubic", "must be one of: spectral, finite-difference; got 'cubic'"),
    ("system.spin_up=-1", "system.spin_up must be at least 0; got -1"),
    ("system.parameters.c=fast", "fast"),
    ("system.start.u=[1]", "system.start.u must be a number or an expression"),
    ("system.start.u=true", "system.start.u must be a number or an expression"),
    ("system.spread.u=-1", "system.spread.u is -1"),
    ("system.spread.u=-1%", "system.spread.u is '-1%'"),
    ("system.spread.u=[1]", "system.spread.u is [1]"),
    ("system.spread.u=true", "system.spread.u is True"),
    ("system.spread.u=lots%", "system.spread.u must be a number: "),
    ("system.title=${seed}", "interpolation"),
    ("system.start.u=???", "still missing"),
    ("shred.decoder=[8", "shred.decoder: "),
]


@pytest.mark.parametrize(("word", "what"), WRONG_VALUES)
def test_wrong_values(write: Any, word: str, what: str) -> None:
    error = refused(write, word)
    assert what in error.what
    assert error.where == "command line"


def test_a_word_that_names_no_cluster_is_answered_with_the_possible_ones(write: Any) -> None:
    hint = refused(write, "cluster=fast").hint
    assert hint == "cluster=local|N|tcp://HOST:PORT|slurm:N|kubernetes:N"


def test_a_comma_within_parentheses_does_not_end_an_item() -> None:
    values, lines = read_text('[1, d(u, x), "d(u", v*d(d(u, x, 2), x), 2]', label="a", key="u")
    assert values == [1, "d(u, x)", "d(u", "v*d(d(u, x, 2), x)", 2]
    assert "u[4]" in lines and "u[5]" not in lines


WRONG_FILES = [
    ("seed: 1\nseed: 2\n", "wave.yaml:2", "duplicate key 'seed'"),
    ("seed:\n\t- 1\n", "wave.yaml:2:1", "\\t"),
    ("seed: [1\nx: 2\n", "wave.yaml:2:2", "expected ',' or ']'"),
    ("fields: {u: height [m]}\n", "wave.yaml:1:20", "expected ',' or '}', but got '['"),
    ("seed: 1: 2\n", "wave.yaml:1:8", "mapping values are not allowed here"),
    ("- a\n- b\n", "wave.yaml", "expected keys and values"),
    ("seed: !!python/name:os.system 3\n", "wave.yaml:1", "YAML tags are not supported"),
    ("seed: !!int abc\n", "wave.yaml:1", "cannot read 'abc'"),
    ("a: &a 1\nb: *a\n", "wave.yaml:2:4", "aliases"),
    ("1: 2\n", "wave.yaml:1", "a key must be a name, not 1"),
    ("---\nseed: 1\n---\nseed: 2\n", "wave.yaml:3:1", "but found another document"),
    ("seed: \x01\n", "wave.yaml:1", "not allowed"),
    ("[" * 500, "wave.yaml:1:50", "nested too deeply"),
    ("system: {start: {u: " + "[" * 40 + "]" * 40 + "}}", "wave.yaml:1", "nested too deeply"),
    ("library: {u: [u, d(u, x]}\n", "wave.yaml:1", "unbalanced ( ) in 'd(u, x'"),
    ("library: {u: d(u, x}\n", "wave.yaml:1", "unbalanced ( ) in 'd(u, x'"),
    ("system: 3\n", "wave.yaml:1", "system must be a section of keys; got 3"),
    ("recording:\n", "wave.yaml:1", "recording must be a section of keys; got nothing"),
    ("\n\nshred: {lag: 3}\n", "wave.yaml:3", "unknown key shred.lag"),
    ("system:\n  parameters: {a b: 1}\n", "wave.yaml:2", "'a b' is not a valid name"),
    ("", "wave.yaml", "missing: system.equations, system.fields"),
    ("seed: 1\nsystem: {title: T}\n", "wave.yaml:2", "missing: system.equations, system.fields"),
    (swapped("twin: a", "noise: 0"), "wave.yaml:13", "no recording to analyse"),
    (swapped("dt: 0.1/15", "rtol: 1e-3"), "wave.yaml:12", "a twin needs a time step"),
    (swapped("dt: 0.1/15", "dt: 0.1//15"), "wave.yaml:12", "dt must be a number: "),
    (swapped("u: sin(x), v: 0", "u: 1"), "wave.yaml:10", "system.start is missing the field v"),
    (swapped("    u: v\n", ""), "wave.yaml:7", "system.equations is missing the field u"),
    (swapped("    u: v\n", "    u: v\n    w: v\n"), "wave.yaml:9", "names w, which is not a"),
    (swapped("u: height, v: speed", ""), "wave.yaml:4", "at least one field"),
    (swapped("c: 1.0", "lambda: 1.0"), "wave.yaml:5", "'lambda' is a Python keyword"),
    (swapped("c: 1.0", "sin: 1.0"), "wave.yaml:5", "belongs to the equation language"),
    (swapped("c: 1.0", "v: 1.0"), "wave.yaml:5", "the name 'v' is also used in system.fields"),
    (swapped("points: 64}", "points: 64}, y: {length: 1, points: 8}, z: {length: 1, points: 8}"),
     "wave.yaml:3", "at most two axes"),
]  # fmt: skip


@pytest.mark.parametrize(("text", "where", "what"), WRONG_FILES)
def test_wrong_files(write: Any, text: str, where: str, what: str) -> None:
    error = refused(write, text=text)
    assert what in error.what
    assert error.where == where


PROCESS = "spread: {kind: gaussian-process, length: pi/6, modes: 9, apply: {u: u*(1 + g)}}"
WRONG_PROCESSES = [
    ("gaussian-process", "fractal", "unknown kind 'fractal'"),
    ("modes: 9", "mode: 9", "unknown key system.spread.mode"),
    ("modes: 9, ", "", "missing: system.spread.modes"),
    ("modes: 9", "modes: 0", "system.spread.modes must be a positive integer"),
    ("length: pi/6", "length: -1", "system.spread.length must be a positive number"),
    ("apply: {u: u*(1 + g)}", "apply: 3", "system.spread.apply must be a section"),
    ("apply: {u", "apply: {w", "system.spread.apply names w"),
]


def test_a_process_may_spread_the_start(write: Any) -> None:
    config = write(text=swapped("spread: {u: 10%, v: 0.05}", PROCESS))
    assert config.system.spread["length"] == pytest.approx(math.pi / 6)


def test_a_spread_per_field_may_be_smooth(write: Any) -> None:
    config = write(text=swapped("v: 0.05}", "v: 0.1/2, length: pi/6}"))
    assert config.system.spread["length"] == pytest.approx(math.pi / 6)


@pytest.mark.parametrize(("old", "new", "what"), WRONG_PROCESSES)
def test_wrong_processes(write: Any, old: str, new: str, what: str) -> None:
    text = swapped("spread: {u: 10%, v: 0.05}", PROCESS.replace(old, new))
    error = refused(write, text=text)
    assert what in error.what
    assert error.where == "wave.yaml:11"


def test_a_file_that_is_not_utf8(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(tmp_path)
    Path("wave.yaml").write_bytes(b"seed: 1\nsystem: {title: \xff}\n")
    with pytest.raises(InputError, match=r"wave.yaml:2: the file is not UTF-8"):
        load_config(["conf=wave.yaml"], entry="train")


@pytest.mark.parametrize(
    ("words", "what"),
    [
        ([], "conf= is missing"),
        (["conf=rde", "conf=rde"], "conf= is given twice"),
        (["conf="], "conf= is empty"),
        (["conf=rdee"], "unknown conf 'rdee'"),
        (["conf=base"], "unknown conf 'base'"),
        (["conf=twins"], "unknown conf 'twins'"),
        (["conf=twins/a"], "unknown conf 'twins/a'"),
        (["conf=nowhere.yaml"], "there is no such file"),
        ([f"conf={BASE}"], "base.yaml holds the defaults"),
    ],
)
def test_no_system(words: list[str], what: str) -> None:
    with pytest.raises(InputError) as caught:
        load_config(words, entry="train")
    assert what in caught.value.what


def test_a_recording_is_no_system_and_init_makes_one(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(tmp_path)
    Path("swing.csv").touch()
    with pytest.raises(
        InputError, match=r"swing\.csv is a recording, not a configuration"
    ) as caught:
        load_config(["conf=swing.csv"], entry="train")
    assert caught.value.hint == "dashred init path=swing.csv writes a first one for it"


def test_an_unknown_system_gets_the_nearest_and_the_list() -> None:
    with pytest.raises(InputError) as caught:
        load_config(["conf=rdee"], entry="train")
    assert caught.value.hint is not None
    assert "did you mean conf=rde?" in caught.value.hint
    assert ", ".join(bundled_names()) in caught.value.hint


def test_a_twin_file_is_not_a_system(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    (tmp_path / "twins").mkdir()
    (tmp_path / "twins" / "a.yaml").write_text("seed: 1\n")
    monkeypatch.setattr("dashred.config.commandline.CONF", tmp_path)
    with pytest.raises(InputError, match="hidden truth"):
        load_config([f"conf={tmp_path / 'twins' / 'a.yaml'}"], entry="train")


# InputError is the only exception, whatever the input.
ATOMS = st.none() | st.booleans() | st.integers() | st.floats() | st.text(max_size=12)
TREES = st.recursive(
    ATOMS, lambda x: st.lists(x, max_size=3) | st.dictionaries(st.text(max_size=6), x, max_size=3)
)
QUICK = settings(
    max_examples=60,
    deadline=None,
    suppress_health_check=[HealthCheck.function_scoped_fixture],
)
KEYS = sorted(
    f"{name}.{member}" if dataclasses.is_dataclass(kind) else name
    for name, kind in get_type_hints(Settings).items()
    for member in (get_type_hints(kind) if dataclasses.is_dataclass(kind) else [""])
)


@QUICK
@given(text=st.text(alphabet="seduv:{}[],-|>&*!%@`'\"#?. \n\t\r\0é=$()09", max_size=40))
def test_any_text_loads_or_is_refused(write: Any, text: str) -> None:
    for whole in (text, SYSTEM + text):
        try:
            write(text=whole)
        except InputError as error:
            assert str(error).startswith(("wave.yaml", "conf/base.yaml"))


@QUICK
@given(key=st.sampled_from(KEYS), value=TREES)
def test_any_value_loads_or_is_refused(write: Any, key: str, value: Any) -> None:
    section, _, name = key.partition(".")
    tree = yaml.safe_load(SYSTEM)
    if name:
        tree.setdefault(section, {})[name] = value
    else:
        tree[section] = value
    try:
        write(text=yaml.safe_dump(tree, allow_unicode=True))
    except InputError as error:
        assert str(error).startswith(("wave.yaml", "conf/base.yaml"))


@QUICK
@given(key=st.sampled_from(KEYS) | st.text(max_size=12), value=st.text(max_size=12))
def test_any_word_loads_or_is_refused(write: Any, key: str, value: str) -> None:
    try:
        write(f"{key}={value}")
    except InputError as error:
        assert error.where


# --- speed and help ------------------------------------------------------------------------------


def test_help_shows_every_default(capsys: pytest.CaptureFixture[str]) -> None:
    with pytest.raises(SystemExit) as caught:
        load_config(["conf=rde", "--help"], entry="train")
    assert caught.value.code == 0
    assert capsys.readouterr().out == usage("train") + "\n"
    assert "dashred train" in usage("train")
    assert BASE.read_text() in usage("train")


def test_a_wrong_input_is_answered_without_torch() -> None:
    program = """
import sys
from dashred.config import load_config
from dashred.core.command_line.entry import run_entry
code = run_entry(lambda words: load_config(["conf=rde", "system.integrator.dt=2*x"], entry="train"))
print(code, sorted({"torch", "lightning", "mlflow", "numpy"} & set(sys.modules)))
"""
    done = subprocess.run([sys.executable, "-c", program], capture_output=True, text=True)
    assert done.stdout == "2 []\n"
    assert done.stderr.startswith("error: command line: ")


@pytest.mark.parametrize(
    ("first", "second", "expected"),
    [
        ("[]", "{a: b}", "must be a list, not a section of keys"),
        ("{a: 1}", "[s1]", "must be a section of keys, not a list"),
    ],
)
def test_a_list_and_a_section_do_not_replace_each_other(
    write: Any, first: str, second: str, expected: str
) -> None:
    text = SYSTEM + f"splits: {{sensors: {{validate: {first}}}}}\n"
    error = refused(write, f"splits.sensors.validate={second}", text=text)
    assert expected in error.what and "splits.sensors.validate" in error.what


def test_a_number_beyond_floats_is_an_input_error(tmp_path: Path) -> None:
    source = Source({"system": {"parameters": {"c": 10**400}}}, {"": "a dict"})
    with pytest.raises(InputError, match="c must be finite"):
        prepare(source, folder=tmp_path)
