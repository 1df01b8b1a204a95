"""The page of every key, ``docs/config.md``, from the schema's text and the defaults' file."""

from __future__ import annotations

import ast
import inspect
import json
from collections.abc import Iterable, Iterator
from dataclasses import MISSING, Field, dataclass, fields, is_dataclass
from itertools import pairwise
from typing import Annotated, Any, Literal, get_args, get_origin, get_type_hints

from dashred.config.commandline import BASE
from dashred.config.schema.settings import Settings
from dashred.config.schema.types import optional, required
from dashred.config.source import read_file
from dashred.core.limits import Limit, Unit

HEAD = """\
# Every key of a configuration

Made by `python -m dashred.reference path=docs/config.md` from `dashred/config/schema/settings.py`, its
parts `system_schema.py` and `recording_schema.py`, and `conf/base.yaml`: change those, not this
page.

A run reads three layers, each over the one before: `conf/base.yaml` with the defaults below, the
system's own file (`conf=rde`, or a path), and the words of the command line, where a dotted key
stands for its section: `recording.noise=0.01 shred.lags=30`. Where a number is asked for,
arithmetic such as `2*pi` will do. Paths count from the folder of the file that holds them, on the
command line from where you are. An unknown key is refused with the nearest known one. A system's
file that says where results go (`output`, `tracking.root`, `tracking.run`, `tracking.parent`) is
refused, too: it may be a stranger's, and those are for the command line to say.

*Unit*: what a number counts in. "The system's time" is whatever time is counted in in its
equations and its recording; a number in "the equation's tendency" is a share of it. What has no
unit is a plain number. *Default*: *must be given* is said where neither file has one.
"""
WORDS = {int: "whole number", float: "number", str: "text", bool: "`true` or `false`"}
COLUMNS = ("key", "meaning", "type and limits", "unit", "default")


@dataclass(frozen=True)
class Key:
    """One key as the page tells it.

    Attributes:
        name: dotted.
        kind: its annotation, limits and unit included.
        meaning: the text below it in the schema.
        default: as YAML; None where it must be given.
    """

    name: str
    kind: Any
    meaning: str
    default: str | None


def page() -> str:
    """Return the page; the same schema and defaults give the same text."""
    defaults = read_file(BASE, label="conf/base.yaml").values
    return "\n".join([HEAD, *_section("", Settings, defaults)])


def keys() -> list[Key]:
    """Return every key that is no section, in the schema's order."""
    defaults = read_file(BASE, label="conf/base.yaml").values
    return list(_walk("", Settings, defaults))


def _walk(prefix: str, kind: type, defaults: dict[str, Any]) -> Iterator[Key]:
    yield from _plain_keys(prefix, kind, defaults)
    for name, section in _subsections(prefix, kind):
        yield from _walk(f"{name}.", section, _below(defaults, name[len(prefix) :]))


def _section(prefix: str, kind: type, defaults: dict[str, Any]) -> Iterator[str]:
    """One heading and table, and those of the sections within."""
    title = f"`{prefix[:-1]}`" if prefix else "At the top"
    yield f"## {title}\n\n{_tidy(inspect.getdoc(kind) or '')}\n"
    own = list(_plain_keys(prefix, kind, defaults))
    if own:
        yield "\n".join([_row(COLUMNS), _row(["---"] * len(COLUMNS)), *map(_told, own)]) + "\n"
    for name, section in _subsections(prefix, kind):
        yield from _section(f"{name}.", section, _below(defaults, name[len(prefix) :]))


def _plain_keys(prefix: str, kind: type, defaults: dict[str, Any]) -> Iterator[Key]:
    meanings = _meanings(kind)
    kinds = get_type_hints(kind, include_extras=True)
    for member in fields(kind):
        if _section_of(kinds[member.name]) is None:
            default = _default(member, defaults)
            yield Key(
                prefix + member.name.rstrip("_"), kinds[member.name], meanings[member.name], default
            )


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


def _told(key: Key) -> str:
    default = "*must be given*" if key.default is None else f"`{key.default}`"
    return _row(
        [f"`{key.name}`", _tidy(key.meaning), _in_words(key.kind), unit(key.kind) or "", default]
    )


def _row(cells: Iterable[str]) -> str:
    return f"| {' | '.join(cell.replace('|', chr(92) + '|') for cell in cells)} |"


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
