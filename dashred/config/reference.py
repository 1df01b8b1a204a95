"""Generate the reference of the configuration, ``docs/config.md``, from schema and defaults."""

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
    """One key of the reference.

    Attributes:
        name: dotted name.
        kind: type annotation with limits and unit.
        meaning: its docstring in the schema, on one line.
        default: default as YAML, or None for a required key.
    """

    name: str
    kind: Any
    meaning: str
    default: str | None

    @property
    def words(self) -> str:
        """Type and limits as text."""
        return _type_text(self.kind)

    @property
    def unit(self) -> str | None:
        """Unit, if it has one."""
        return unit(self.kind)


@dataclass(frozen=True)
class Section:
    """A section of the configuration: dotted name, description, and keys."""

    name: str
    about: str
    keys: list[Key]


def page() -> str:
    """Return the reference as Markdown."""
    return render("config/templates/config.md.j2", sections=sections())


def keys() -> list[Key]:
    """Return all keys that are not sections, in the order of the schema."""
    return [key for section in sections() for key in section.keys]


def sections() -> list[Section]:
    """Return all sections, in the order of the schema; the top level has an empty name."""
    defaults = read_file(BASE, label="conf/base.yaml").values
    return list(_walk("", Settings, defaults))


def _walk(prefix: str, kind: type, defaults: dict[str, Any]) -> Iterator[Section]:
    plain = list(_plain_keys(prefix, kind, defaults))
    yield Section(prefix[:-1], _one_line(inspect.getdoc(kind) or ""), plain)
    for name, section in _subsections(prefix, kind):
        yield from _walk(f"{name}.", section, _below(defaults, name[len(prefix) :]))


def _plain_keys(prefix: str, kind: type, defaults: dict[str, Any]) -> Iterator[Key]:
    meanings = _meanings(kind)
    kinds = get_type_hints(kind, include_extras=True)
    for member in fields(kind):
        if _section_of(kinds[member.name]) is None:
            name, meaning = prefix + member.name.rstrip("_"), _one_line(meanings[member.name])
            yield Key(name, kinds[member.name], meaning, _default(member, defaults))


def _subsections(prefix: str, kind: type) -> Iterator[tuple[str, type]]:
    for name, member in get_type_hints(kind).items():
        if (section := _section_of(member)) is not None:
            named = get_origin(required(member)) is dict
            yield f"{prefix}{name}{'.NAME' if named else ''}", section


def _section_of(kind: Any) -> type | None:
    """Return the dataclass of a section, or of a dict of sections; None for a plain key."""
    bare = required(kind)
    if get_origin(bare) is dict:
        bare = get_args(bare)[1]
    return bare if isinstance(bare, type) and is_dataclass(bare) else None


def _below(defaults: dict[str, Any], name: str) -> dict[str, Any]:
    result = defaults.get(name)
    return result if isinstance(result, dict) else {}


def _meanings(kind: type) -> dict[str, str]:
    """Return the docstring of each key of a section, which Python does not keep."""
    [section] = ast.parse(inspect.getsource(kind)).body
    assert isinstance(section, ast.ClassDef)
    meanings = {}
    for key, below in pairwise([*section.body, ast.Pass()]):
        match key, below:
            case ast.AnnAssign(target=ast.Name(id=name)), ast.Expr(value=ast.Constant(value=text)):
                meanings[name] = str(text)
            case ast.AnnAssign(target=ast.Name(id=name)), _:
                meanings[name] = ""
    return meanings


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


def _one_line(text: str) -> str:
    """Return a docstring as one line of Markdown."""
    return " ".join(text.replace("``", "`").split())


def _type_text(kind: Any) -> str:
    """Return a type as text, such as ``list of whole numbers, each at least 1``."""
    bare, limit = _bare(kind), _annotation(kind, Limit)
    if bare is Any:
        return "see the meaning"
    if get_origin(bare) is Literal:
        words = " or ".join(f"`{choice}`" for choice in get_args(bare))
    elif get_origin(bare) is list:
        within = _annotation(get_args(bare)[0], Limit)
        words = f"list of {_plural(bare)}" + (f", each {within}" if within else "")
    elif get_origin(bare) is dict:
        words = _plural(bare)
    else:
        words = WORDS[bare] + (f" {limit}" if limit else "")
    return f"{words}; or `null`" if optional(kind) else words


def _plural(kind: Any) -> str:
    """Return the items of a list or dict as text, such as ``numbers by name``."""
    *_, inner = (_bare(part) for part in get_args(kind))
    if inner is Any:
        words = "anything"
    elif get_origin(inner) is list:
        words = f"lists of {_plural(inner)},"
    else:
        words = _plural(inner) + "," if get_args(inner) else f"{WORDS[inner]}s"
    return f"{words} by name" if get_origin(kind) is dict else words


def unit(kind: Any) -> str | None:
    """Return the unit of a number or of the numbers in a list."""
    annotation = _annotation(kind, Unit)
    if annotation is None and get_origin(_bare(kind)) is list:
        annotation = _annotation(get_args(_bare(kind))[0], Unit)
    return annotation.name if annotation else None


def _bare(kind: Any) -> Any:
    kind = required(kind)
    return get_args(kind)[0] if get_origin(kind) is Annotated else kind


def _annotation(kind: Any, sort: type) -> Any:
    kind = required(kind)
    result = get_args(kind)[1:] if get_origin(kind) is Annotated else ()
    return next((each for each in result if isinstance(each, sort)), None)
