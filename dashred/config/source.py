"""YAML text → plain values, and the line on which each key stands.

A small YAML: text, numbers, true and false, null, lists and mappings. Not taken over from
YAML 1.1: ``yes``/``no``/``on`` as booleans, dates, base-60 and octal numbers (all of them
surprises in a file of equations), and ``1e-3`` as a text. Refused: duplicate keys, aliases, tags.
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
QUOTE = "quote a text that holds ': ' or ' #', or that begins with one of * & ! % @ ` [ { - |"
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
DEEPEST = 12
# More than anybody writes by hand; larger files would be read for minutes.
LARGEST, MOST_VALUES = 100_000, 2000
COMMA = "inside [ ] and { } a comma ends a text: put quotes around an expression that holds one"


@dataclass(frozen=True)
class Source:
    """A mapping as it was written, and where.

    Attributes:
        values: plain nested dicts and lists of str, int, float, bool and None.
        lines: ``FILE:LINE`` of each dotted key, list items as ``key[0]``; of the empty
            key, ``FILE``.
    """

    values: dict[str, Any]
    lines: dict[str, str]


def read_file(path: Path, *, label: str) -> Source:
    """Read a YAML file that holds one mapping.

    Args:
        path: the file.
        label: its name in messages.

    Raises:
        InputError: the file is missing or not UTF-8, or it is not a mapping in this small YAML.
    """
    try:
        with path.open("rb") as file:
            data = file.read(LARGEST + 1)
        text = data.decode("utf-8-sig")
    except OSError as error:
        raise InputError(f"cannot read the file: {error.strerror}", where=label) from None
    except UnicodeDecodeError as error:
        line = error.object.count(b"\n", 0, error.start) + 1
        raise InputError(
            "the file is not UTF-8", where=f"{label}:{line}", hint="save it as UTF-8 text"
        ) from None
    if len(data) > LARGEST:
        problem = f"the file is larger than {LARGEST} bytes"
        raise InputError(problem, where=label, hint="recordings have files of their own")
    values, lines = read_text(text, label=label)
    if values is None:
        values = {}
    if not isinstance(values, dict):
        raise InputError("expected keys and values", where=label, hint="for example 'seed: 1'")
    return Source(values, lines | {"": label})


def read_text(text: str, *, label: str, key: str = "") -> tuple[Any, dict[str, str]]:
    """Read one YAML document: its value, and the lines of its keys, all of them below ``key``.

    Raises:
        InputError: ``LABEL:LINE:COLUMN`` and what is wrong there.
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
        raise InputError("nested too deeply", where=label) from None
    reader = _Reader(label)
    value = None if node is None else reader.value(node, key)
    return value, reader.lines


def plain(text: str, *, where: str) -> str:
    """Return the text as it is, unless it cannot be printed or OmegaConf would read more into it.

    Raises:
        InputError: it holds an interpolation, the mark of a missing value, or a control character.
    """
    if sign := first_unprintable(text):
        problem = f"the character {sign!r} cannot stand in a text"
        raise InputError(problem, where=where, hint="write plain text")
    if "${" in text:
        raise InputError(
            "interpolation with ${...} is not used here",
            where=where,
            hint="write the value itself; equations may name parameters and lets",
        )
    if text == "???":
        raise InputError("a value is still to be filled in here", where=where)
    return text


def _hint(error: yaml.MarkedYAMLError) -> str:
    return "indent with spaces, not tabs" if "\\t" in (error.problem or "") else QUOTE


class _Loader(yaml.SafeLoader):
    """PyYAML's composer with the scalars of YAML 1.2's core, and without aliases."""

    yaml_implicit_resolvers = {None: [(TAG + kind, SCALARS[kind]) for kind in SCALARS]}  # noqa: RUF012

    depth = count = 0

    def compose_node(self, parent: Node | None, index: Any) -> Node | None:
        """Refuse aliases, a bomb of which is endless to read, and towers, and endless lists."""
        mark = self.peek_event().start_mark  # type: ignore[no-untyped-call]
        if self.check_event(yaml.AliasEvent):
            raise yaml.composer.ComposerError(None, None, "YAML aliases are not used here", mark)
        if self.depth > 4 * DEEPEST:
            raise yaml.composer.ComposerError(None, None, "nested too deeply", mark)
        if self.count > MOST_VALUES:
            raise yaml.composer.ComposerError(None, None, f"over {MOST_VALUES} values", mark)
        self.count += 1
        self.depth += 1
        node = super().compose_node(parent, index)
        self.depth -= 1
        return node


class _Reader:
    """Node tree → plain values; remembers the line of every key on the way."""

    def __init__(self, label: str) -> None:
        self.label = label
        self.lines: dict[str, str] = {}

    def value(self, node: Node, key: str, *, in_flow: bool = False) -> Any:
        if key.count(".") + key.count("[") > DEEPEST:
            raise InputError("nested too deeply", where=self._line(node))
        if key:
            self.lines.setdefault(key, self._line(node))
        if isinstance(node, MappingNode) and node.tag == TAG + "map":
            return self._mapping(node, key)
        if isinstance(node, SequenceNode) and node.tag == TAG + "seq":
            items = enumerate(node.value)
            return [self.value(x, f"{key}[{i}]", in_flow=bool(node.flow_style)) for i, x in items]
        if isinstance(node, ScalarNode):
            return self._scalar(node, in_flow=in_flow)
        raise InputError(f"YAML tags are not used here: {node.tag}", where=self._line(node))

    def _mapping(self, node: MappingNode, parent: str) -> dict[str, Any]:
        values: dict[str, Any] = {}
        for name_node, value_node in node.value:
            name = self._name(name_node, in_flow=bool(node.flow_style))
            if name in values:
                raise InputError(f"the key {name!r} stands here twice", where=self._line(name_node))
            key = f"{parent}.{name}" if parent else name
            self.lines[key] = self._line(name_node)
            values[name] = self.value(value_node, key, in_flow=bool(node.flow_style))
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
            if in_flow and node.style is None and text.count("(") != text.count(")"):
                what = f"unbalanced ( ) in {text!r}"
                raise InputError(what, where=self._line(node), hint=COMMA)
            return plain(text, where=self._line(node))
        if kind not in CONVERT:
            raise InputError(f"YAML tags are not used here: {node.tag}", where=self._line(node))
        try:
            return CONVERT[kind](text)
        except ValueError:
            what = f"cannot read {text[:40]!r} as a value"
        raise InputError(what, where=self._line(node), hint=QUOTE)

    def _line(self, node: Node) -> str:
        return f"{self.label}:{node.start_mark.line + 1}"
