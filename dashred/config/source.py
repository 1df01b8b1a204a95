"""Parser of a YAML subset to plain values, with the line number of each key.

The subset has texts, numbers, true and false, null, lists and mappings. Unlike YAML 1.1, it does
not read ``yes``/``no``/``on`` as booleans, has no dates, base-60 or octal numbers, and reads
``1e-3`` as a number. Duplicate keys, aliases and tags are errors.
"""

from __future__ import annotations

import re
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import yaml
from yaml.nodes import MappingNode, Node, ScalarNode, SequenceNode

from dashred.core.errors import InputError
from dashred.core.files.plain_text import first_unprintable

TAG = "tag:yaml.org,2002:"
QUOTE = "quote a text that contains ': ' or ' #', or begins with one of * & ! % @ ` [ { - |"
SCALARS = {
    "null": re.compile(r"^(?:~|null|Null|NULL|)$"),
    "bool": re.compile(r"^(?:true|True|TRUE|false|False|FALSE)$"),
    "int": re.compile(r"^[-+]?[0-9]{1,18}$"),
    "float": re.compile(r"^[-+]?(?:\.[0-9]+|[0-9]+(?:\.[0-9]*)?)(?:[eE][-+]?[0-9]+)?$"),
}
CONVERT: dict[str, Callable[[str], Any]] = {
    "null": lambda _: None,
    "bool": lambda text: text.lower() == "true",
    "int": int,
    "float": float,
}
MAX_DEPTH = 12
# Larger than any file written by hand; reading more would take minutes.
MAX_BYTES, MAX_VALUES = 100_000, 2000
BRACKET = "inside { } a text with [ ], such as a unit, needs quotes"
OPEN = "close every ( with a ), or put the text into quotes"


@dataclass(frozen=True)
class Source:
    """A mapping, with the location of each key.

    Attributes:
        values: plain nested dicts and lists of str, int, float, bool and None.
        lines: ``FILE:LINE`` of each dotted key, list items as ``key[0]``; of the empty
            key, ``FILE``.
    """

    values: dict[str, Any]
    lines: dict[str, str]


def section_of(values: dict[str, Any], name: str) -> dict[str, Any]:
    """Return a copy of a section, empty if there is none; other values are refused later."""
    found = values.get(name)
    return dict(found) if isinstance(found, dict) else {}


def read_file(path: Path, *, label: str) -> Source:
    """Read a YAML file with one mapping.

    Args:
        path: of the file.
        label: name of the file in error messages.

    Raises:
        InputError: the file is missing, not UTF-8, or not a mapping in this subset of YAML.
    """
    try:
        with path.open("rb") as file:
            data = file.read(MAX_BYTES + 1)
        text = data.decode("utf-8-sig")
    except OSError as error:
        raise InputError(f"cannot read the file: {error.strerror}", where=label) from None
    except UnicodeDecodeError as error:
        line = error.object.count(b"\n", 0, error.start) + 1
        raise InputError(
            "the file is not UTF-8", where=f"{label}:{line}", hint="save it as UTF-8 text"
        ) from None
    if len(data) > MAX_BYTES:
        problem = f"the file is larger than {MAX_BYTES} bytes"
        raise InputError(problem, where=label, hint="keep data in separate files")
    values, lines = read_text(text, label=label)
    if values is None:
        values = {}
    if not isinstance(values, dict):
        raise InputError("expected keys and values", where=label, hint="for example 'seed: 1'")
    return Source(values, lines | {"": label})


def read_text(text: str, *, label: str, key: str = "") -> tuple[Any, dict[str, str]]:
    """Read one YAML document; return its value and the lines of its keys, prefixed by ``key``.

    Raises:
        InputError: the text is invalid, with ``LABEL:LINE:COLUMN``.
    """
    try:
        loader = _Loader(text)
        node = loader.get_single_node()
    except yaml.MarkedYAMLError as error:
        mark = error.problem_mark or error.context_mark
        where = f"{label}:{mark.line + 1}:{mark.column + 1}" if mark else label
        raise InputError(error.problem or "broken YAML", where=where, hint=_hint(error)) from None
    except yaml.reader.ReaderError as error:
        line = text.count("\n", 0, error.position) + 1
        raise InputError(
            f"the character {chr(error.character)!r} is not allowed", where=f"{label}:{line}"
        ) from None
    except RecursionError:
        raise InputError("the value is nested too deeply", where=label) from None
    reader = _Reader(label)
    value = None if node is None else reader.value(node, key)
    return value, reader.lines


def check_text(text: str, *, where: str) -> str:
    """Return a text unchanged if it is printable and has no special meaning in OmegaConf.

    Raises:
        InputError: it contains an interpolation or a control character, or is ``???``.
    """
    if sign := first_unprintable(text):
        problem = f"the character {sign!r} is not allowed in a text"
        raise InputError(problem, where=where, hint="write plain text")
    if "${" in text:
        raise InputError(
            "interpolation with ${...} is not supported",
            where=where,
            hint="write the value itself; equations may name parameters and lets",
        )
    if text == "???":
        raise InputError("this value is still missing", where=where)
    return text


def _hint(error: yaml.MarkedYAMLError) -> str:
    problem = error.problem or ""
    if "\\t" in problem:
        return "indent with spaces, not tabs"
    return BRACKET if "got '['" in problem else QUOTE


class _Loader(yaml.SafeLoader):
    """PyYAML's composer with the scalars of YAML 1.2's core, and without aliases."""

    yaml_implicit_resolvers = {None: [(TAG + kind, SCALARS[kind]) for kind in SCALARS]}  # noqa: RUF012

    depth = count = 0

    def compose_node(self, parent: Node | None, index: Any) -> Node | None:
        """Refuse aliases, deep nesting and too many values, which could take forever to read."""
        mark = self.peek_event().start_mark  # type: ignore[no-untyped-call]
        if self.check_event(yaml.AliasEvent):
            raise yaml.composer.ComposerError(None, None, "YAML aliases are not supported", mark)
        if self.depth > 4 * MAX_DEPTH:
            raise yaml.composer.ComposerError(None, None, "nested too deeply", mark)
        if self.count > MAX_VALUES:
            raise yaml.composer.ComposerError(None, None, f"more than {MAX_VALUES} values", mark)
        self.count += 1
        self.depth += 1
        node = super().compose_node(parent, index)
        self.depth -= 1
        return node


def _join_calls(items: list[Node]) -> list[Node]:
    """Join items of a list in [ ] that a comma within parentheses has separated: ``[d(u, x)]``."""
    joined: list[Node] = []
    for item in items:
        before = joined[-1] if joined else None
        is_part = isinstance(item, ScalarNode) and item.style is None
        if is_part and isinstance(before, ScalarNode) and _open_parentheses(before) > 0:
            text = f"{before.value}, {item.value}"
            joined[-1] = ScalarNode(TAG + "str", text, before.start_mark, item.end_mark)
        else:
            joined.append(item)
    return joined


def _join_calls_of_pairs(pairs: list[tuple[Node, Node]]) -> list[tuple[Node, Node]]:
    """Join what a comma within parentheses has separated in { }: ``{u: d(u, x), v: 1}``."""
    joined: list[tuple[Node, Node]] = []
    for name, value in pairs:
        before = joined[-1][1] if joined else None
        # The rest of a call is a plain name, and what follows the comma is no pair of its own.
        is_part = isinstance(name, ScalarNode) and name.style is None
        is_alone = isinstance(value, ScalarNode) and value.style is None and not value.value
        is_open = isinstance(before, ScalarNode) and _open_parentheses(before) > 0
        if is_part and is_alone and is_open:
            [text] = _join_calls([joined[-1][1], name])
            joined[-1] = (joined[-1][0], text)
        else:
            joined.append((name, value))
    return joined


def _open_parentheses(node: ScalarNode) -> int:
    """Return by how many the parentheses that open exceed those that close; 0 if quoted."""
    return 0 if node.style else int(node.value.count("(") - node.value.count(")"))


class _Reader:
    """Conversion of a node tree to plain values; records the line of every key."""

    def __init__(self, label: str) -> None:
        self.label = label
        self.lines: dict[str, str] = {}

    def value(self, node: Node, key: str, *, in_flow: bool = False) -> Any:
        if key.count(".") + key.count("[") > MAX_DEPTH:
            raise InputError("the value is nested too deeply", where=self._line(node))
        if key:
            self.lines.setdefault(key, self._line(node))
        if isinstance(node, MappingNode) and node.tag == TAG + "map":
            return self._mapping(node, key)
        if isinstance(node, SequenceNode) and node.tag == TAG + "seq":
            in_flow = bool(node.flow_style)
            items = enumerate(_join_calls(node.value) if in_flow else node.value)
            return [self.value(x, f"{key}[{i}]", in_flow=in_flow) for i, x in items]
        if isinstance(node, ScalarNode):
            return self._scalar(node, in_flow=in_flow)
        raise InputError(f"YAML tags are not supported: {node.tag}", where=self._line(node))

    def _mapping(self, node: MappingNode, parent: str) -> dict[str, Any]:
        values: dict[str, Any] = {}
        in_flow = bool(node.flow_style)
        for name_node, value_node in _join_calls_of_pairs(node.value) if in_flow else node.value:
            name = self._name(name_node, in_flow=in_flow)
            if name in values:
                raise InputError(f"duplicate key {name!r}", where=self._line(name_node))
            key = f"{parent}.{name}" if parent else name
            self.lines[key] = self._line(name_node)
            values[name] = self.value(value_node, key, in_flow=in_flow)
        return values

    def _name(self, node: Node, *, in_flow: bool) -> str:
        name = self._scalar(node, in_flow=in_flow) if isinstance(node, ScalarNode) else None
        if not isinstance(name, str):
            raise InputError(
                f"a key must be a name, not {name!r}",
                where=self._line(node),
                hint="keys begin with a letter",
            )
        return name

    def _scalar(self, node: ScalarNode, *, in_flow: bool) -> Any:
        text: str = node.value
        kind = node.tag.removeprefix(TAG)
        if kind == "str":
            if in_flow and _open_parentheses(node):
                what = f"unbalanced ( ) in {text!r}"
                raise InputError(what, where=self._line(node), hint=OPEN)
            return check_text(text, where=self._line(node))
        if kind not in CONVERT:
            raise InputError(f"YAML tags are not supported: {node.tag}", where=self._line(node))
        try:
            return CONVERT[kind](text)
        except ValueError:
            what = f"cannot read {text[:40]!r} as a value"
        raise InputError(what, where=self._line(node), hint=QUOTE)

    def _line(self, node: Node) -> str:
        return f"{self.label}:{node.start_mark.line + 1}"
