"""The page of every key, ``docs/config.md``, from the schema's text and the defaults' file."""

from __future__ import annotations

import ast
import inspect
import json
from collections.abc import Iterator
from dataclasses import MISSING, Field, dataclass, fields, is_dataclass
from itertools import pairwise
from typing import Annotated, Any, Literal, get_args, get_origin, get_type_hints

from dashred.config.bundled_systems import BASE
from dashred.config.schema.settings import Settings
from dashred.config.schema.types import optional, required
from dashred.config.source import read_file
from dashred.core.limits import Limit, Unit
from dashred.core.templates import render

WORDS = {int: "whole number", float: "number", str: "text", bool: "`true` or `false`"}


@dataclass(frozen=True)
class Key:
    """One key as the page tells it.

    Attributes:
        name: dotted.
        kind: its annotation, limits and unit included.
        meaning: the text below it in the schema, on one line.
        default: as YAML; None where it must be given.
    """

    name: str
    kind: Any
    meaning: str
    default: str | None

    @property
    def words(self) -> str:
        """Its type and limits in words."""
        return _in_words(self.kind)

    @property
    def unit(self) -> str | None:
        """What it counts in."""
        return unit(self.kind)


@dataclass(frozen=True)
class Section:
    """One section of a configuration: its dotted name, what it is, and its own keys."""

    name: str
    about: str
    keys: list[Key]


def page() -> str:
    """Return the page; the same schema and defaults give the same text."""
    return render("config/templates/config.md.j2", sections=sections())


def keys() -> list[Key]:
    """Return every key that is no section, in the schema's order."""
    return [key for section in sections() for key in section.keys]


def sections() -> list[Section]:
    """Return every section, in the schema's order; that of the top has no name."""
    defaults = read_file(BASE, label="conf/base.yaml").values
    return list(_walk("", Settings, defaults))


def _walk(prefix: str, kind: type, defaults: dict[str, Any]) -> Iterator[Section]:
    own = list(_plain_keys(prefix, kind, defaults))
    yield Section(prefix[:-1], _tidy(inspect.getdoc(kind) or ""), own)
    for name, section in _subsections(prefix, kind):
        yield from _walk(f"{name}.", section, _below(defaults, name[len(prefix) :]))


def _plain_keys(prefix: str, kind: type, defaults: dict[str, Any]) -> Iterator[Key]:
    meanings = _meanings(kind)
    kinds = get_type_hints(kind, include_extras=True)
    for member in fields(kind):
        if _section_of(kinds[member.name]) is None:
            name, meaning = prefix + member.name.rstrip("_"), _tidy(meanings[member.name])
            yield Key(name, kinds[member.name], meaning, _default(member, defaults))


def _subsections(prefix: str, kind: type) -> Iterator[tuple[str, type]]:
    for name, member in get_type_hints(kind).items():
        if (section := _section_of(member)) is not None:
            named = get_origin(required(member)) is dict
            yield f"{prefix}{name}{'.NAME' if named else ''}", section


def _section_of(kind: Any) -> type | None:
    """The dataclass that a key holds, or holds by name; None for a plain key."""
    bare = required(kind)
    if get_origin(bare) is dict:
        bare = get_args(bare)[1]
    return bare if isinstance(bare, type) and is_dataclass(bare) else None


def _below(defaults: dict[str, Any], name: str) -> dict[str, Any]:
    found = defaults.get(name)
    return found if isinstance(found, dict) else {}


def _meanings(kind: type) -> dict[str, str]:
    """What stands below each key of a section in the schema; Python itself keeps no such text."""
    [section] = ast.parse(inspect.getsource(kind)).body
    assert isinstance(section, ast.ClassDef)
    told = {}
    for key, below in pairwise([*section.body, ast.Pass()]):
        match key, below:
            case ast.AnnAssign(target=ast.Name(id=name)), ast.Expr(value=ast.Constant(value=text)):
                told[name] = str(text)
            case ast.AnnAssign(target=ast.Name(id=name)), _:
                told[name] = ""
    return told


def _default(member: Field[Any], defaults: dict[str, Any]) -> str | None:
    if member.name in defaults:
        return _yaml(defaults[member.name])
    if member.default is not MISSING:
        return _yaml(member.default)
    if member.default_factory is not MISSING:
        return _yaml(member.default_factory())
    return None


def _yaml(value: Any) -> str:
    if isinstance(value, float):
        return f"{value:g}"
    return value if isinstance(value, str) else json.dumps(value, ensure_ascii=False)


def _tidy(text: str) -> str:
    """One line of Markdown of a docstring."""
    return " ".join(text.replace("``", "`").split())


def _in_words(kind: Any) -> str:
    """``number above 0``, ``list of whole numbers, each at least 1``, ``text; or `null```."""
    bare, limit = _bare(kind), _mark(kind, Limit)
    if bare is Any:
        return "see the meaning"
    if get_origin(bare) is Literal:
        words = " or ".join(f"`{choice}`" for choice in get_args(bare))
    elif get_origin(bare) is list:
        within = _mark(get_args(bare)[0], Limit)
        words = f"list of {_several(bare)}" + (f", each {within}" if within else "")
    elif get_origin(bare) is dict:
        words = _several(bare)
    else:
        words = WORDS[bare] + (f" {limit}" if limit else "")
    return f"{words}; or `null`" if optional(kind) else words


def _several(kind: Any) -> str:
    """What is in a list, or stands by name: ``numbers by name``, ``lists of texts, by name``."""
    *_, inner = (_bare(part) for part in get_args(kind))
    if inner is Any:
        words = "anything"
    elif get_origin(inner) is list:
        words = f"lists of {_several(inner)},"
    else:
        words = _several(inner) + "," if get_args(inner) else f"{WORDS[inner]}s"
    return f"{words} by name" if get_origin(kind) is dict else words


def unit(kind: Any) -> str | None:
    """What a number counts in, or the numbers of a list."""
    mark = _mark(kind, Unit)
    if mark is None and get_origin(_bare(kind)) is list:
        mark = _mark(get_args(_bare(kind))[0], Unit)
    return mark.name if mark else None


def _bare(kind: Any) -> Any:
    kind = required(kind)
    return get_args(kind)[0] if get_origin(kind) is Annotated else kind


def _mark(kind: Any, sort: type) -> Any:
    kind = required(kind)
    carried = get_args(kind)[1:] if get_origin(kind) is Annotated else ()
    return next((mark for mark in carried if isinstance(mark, sort)), None)
