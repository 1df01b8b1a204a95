"""Arbitrary configurations: refused with a location, or read as plain finite values."""

from __future__ import annotations

import dataclasses
from pathlib import Path
from typing import Any, get_type_hints

import yaml
from hypothesis import strategies as st

from dashred.config import Settings, config_sha256, load_config
from dashred.config.commandline import parse_arguments
from dashred.config.layers import prepare
from dashred.config.source import Source, read_text
from dashred.core.errors import InputError
from tests.fuzz.examples import fuzzed

SYSTEM = """\
system:
  title: A wave that dies
  axes: {x: {length: 2*pi, points: 64}}
  fields: {u: height, v: speed}
  parameters: {c: 1.0, nu: 1e-2}
  let: {drag: nu*v}
  equations: {u: v, v: "c**2*d(u, x, 2) - drag"}
  start: {u: sin(x), v: 0}
  spread: {u: 10%, v: 0.05}
  integrator: {dt: 0.1/15}
recording: {twin: a, every: 0.1}
"""


def keys_of(kind: Any, parent: str = "") -> list[str]:
    """Return every dotted key below a section."""
    found = []
    for name, member in get_type_hints(kind).items():
        found.append(parent + name)
        if dataclasses.is_dataclass(member):
            found += keys_of(member, f"{parent}{name}.")
    return found


OPEN_KEYS = ("system.start.u", "system.axes.x.points", "system.let.drag", "system.parameters.c")
INPUT_KEYS = ("system.inputs.f", "system.inputs.f.hold", "system.inputs.f.delay")
SPREAD_KEYS = ("system.spread.u", "system.parameter_spread.c")
MORE_KEYS = ("library.u", "system.class", "class", "conf", "recording.std.u")
KEYS = st.sampled_from([*keys_of(Settings), *OPEN_KEYS, *INPUT_KEYS, *SPREAD_KEYS, *MORE_KEYS])
# Attacks and typing errors.
TAGS = ("!!python/object/apply:os.system [ls]", "!mine x", "&a 1", "*a", "<<: {}", "%TAG", "|\n x")
PLACES = ("${oc.env:HOME}", "${seed}", "???", "../../etc/passwd", "/dev/zero", "~nobody/x", "~")
UNSEEN = ("'\\0'", '"\\0"', '"\\ud800"', '"\\x1b[2J"', "\0", "\udcff", "os.system")
HUGE = ("1e999", ".inf", ".nan", "1e-320", "99999999999999999999", "1e308*10", "2**2**2**2**2")
ODD = ("-1", "-0", "1_0", "0x10", "yes", "true", "null", "[]", "{}", "[[[1]]]", "{a: {b: 1}}", "1%")
EVIL = st.sampled_from([*TAGS, *PLACES, *UNSEEN, *HUGE, *ODD])
SCALARS = EVIL | st.text(max_size=12) | st.integers().map(str) | st.floats().map(repr)
YAML = st.one_of(
    st.text(max_size=60),
    st.text("seduv:{}[],-|>&*!%@`'\"#?. \n\t\r\0é=$()09", max_size=60),
    st.lists(st.tuples(KEYS, SCALARS), max_size=4).map(
        lambda pairs: "\n".join(f"{key.replace('.', ': {', 1)}: {v}" for key, v in pairs)
    ),
    st.builds(lambda a, n, b: a * n + b, st.sampled_from(["[", "{a: ", "- ", "? "]),
              st.integers(1, 300), SCALARS),
)  # fmt: skip


@fuzzed(200, 25_000, text=YAML)
def test_any_text_is_refused_or_plain(text: str) -> None:
    try:
        value, lines = read_text(text, label="a.yaml")
    except InputError as error:
        assert str(error).startswith("a.yaml")
        return
    assert plain(value)
    assert all(line.startswith("a.yaml:") for line in lines.values())


def plain(value: Any) -> bool:
    """Return whether a value consists of plain YAML types only."""
    if isinstance(value, dict):
        return all(type(key) is str and plain(item) for key, item in value.items())
    if isinstance(value, list):
        return all(map(plain, value))
    if type(value) is str:
        value.encode()
        return "${" not in value and "\0" not in value and "\x1b" not in value
    return value is None or type(value) in (int, float, bool)


TREES = st.recursive(
    st.none() | st.booleans() | st.integers() | st.floats() | st.text(max_size=8),
    lambda inner: (
        st.lists(inner, max_size=3)
        | st.dictionaries(st.sampled_from(["u", "v", "x", "points", "a b", "1", ""]), inner)
    ),
    max_leaves=6,
)


@fuzzed(200, 15_000, key=KEYS, value=TREES)
def test_any_value_of_a_key_has_its_shape_or_is_refused(key: str, value: Any) -> None:
    """A single layer has no keys outside the schema."""
    *sections, name = key.split(".")
    tree = {name: value}
    for section in reversed(sections):
        tree = {section: tree}
    try:
        prepare(Source(tree, {"": "a.yaml"}), folder=Path("/nowhere"))
    except InputError as error:
        assert str(error).startswith("a.yaml")


WORDS = st.one_of(
    st.tuples(KEYS, SCALARS).map("=".join),
    st.tuples(KEYS, st.text("[]0.x", max_size=4), SCALARS).map(lambda p: f"{p[0]}{p[1]}={p[2]}"),
    st.text(max_size=20),
)


@fuzzed(200, 20_000, words=st.lists(WORDS, max_size=3))
def test_any_words_are_split_or_refused(words: list[str]) -> None:
    try:
        conf, overrides = parse_arguments(["conf=rde", *words], entry="train")
        prepare(overrides, folder=Path("/nowhere"))
    except InputError as error:
        assert error.where
        return
    assert conf == "rde" and plain(overrides.values)


@fuzzed(10, 1_500, key=KEYS, value=TREES, words=st.lists(WORDS, max_size=1))
def test_a_whole_configuration_is_refused_or_finite(key: str, value: Any, words: list[str]) -> None:
    """An accepted configuration has a hash, and all its numbers are finite."""
    *sections, name = key.split(".")
    tree = yaml.safe_load(SYSTEM)
    below = tree
    for section in sections:
        below = below.setdefault(section, {})
    below[name] = value
    Path("wave.yaml").write_text(yaml.safe_dump(tree, allow_unicode=True), encoding="utf-8")
    try:
        config = load_config(["conf=wave.yaml", *words], entry="train")
    except InputError as error:
        assert error.where
        return
    assert len(config_sha256(config)) == 64
    values = dataclasses.asdict(config)
    assert plain({key: values[key] for key in get_type_hints(Settings)})
