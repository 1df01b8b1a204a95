"""Write the API reference: ``python -m dashred.pipeline.api.reference path=docs/api.md``."""

from __future__ import annotations

import inspect
import re
import sys
from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path
from typing import Any

from dashred.core.command_line.argument_types import read_path
from dashred.core.command_line.arguments import Command, argument
from dashred.core.command_line.entry import run_entry
from dashred.core.errors import DONE
from dashred.core.files.atomic import write_text_atomic
from dashred.core.templates import render

TEMPLATE = "pipeline/api/templates/api.md.j2"
ORDER = ("Problem", "Result", "Simulator", "Plots", "Check", "record", "load", "InputError")
SECTION = re.compile(r"^(Args|Attributes|Returns|Raises):$")
# A Sphinx role, such as :meth:`from_yaml`.
ROLE = re.compile(r":\w+:`~?([^`]+)`")


@dataclass(frozen=True)
class Entry:
    """One documented object.

    Attributes:
        name: qualified name, such as ``Problem.discover``.
        signature: arguments with types and defaults; empty for classes and properties.
        text: paragraphs in Markdown.
        sections: items ``(name, text)`` by section; the name is empty for plain text.
        members: members of a class.
    """

    name: str
    signature: str
    text: str
    sections: dict[str, list[tuple[str, str]]]
    members: list[Entry]


@dataclass(frozen=True, kw_only=True)
class Arguments:
    """Arguments of the command."""

    path: Path = argument(read_path, "FILE.md", "file to write")


COMMAND = Command(
    "python -m dashred.pipeline.api.reference", Arguments, "Writes the reference of the Python API."
)


def main(argv: list[str]) -> int:
    """Write the reference."""
    path = COMMAND.read(argv).path
    # The package is already imported; it imports its public names on first use.
    package = sys.modules["dashred"]
    write_text_atomic(path, render_reference(public_objects(package)))
    print(f"{path} is written")
    return DONE


def public_objects(package: object) -> dict[str, Any]:
    """Return the public objects of the package by name, in the order of the reference."""
    return {name: getattr(package, name) for name in ORDER}


def render_reference(public: Mapping[str, Any]) -> str:
    """Return the reference in Markdown."""
    return render(TEMPLATE, entries=[_entry(name, target) for name, target in public.items()])


def _entry(name: str, target: Any) -> Entry:
    text, sections = _docstring(inspect.getdoc(target) or "")
    members = list(_members(name, target)) if inspect.isclass(target) else []
    signature = _signature(target) if inspect.isfunction(target) else ""
    return Entry(name, signature, text, sections, members)


def _members(name: str, kind: type) -> Iterator[Entry]:
    """Yield the public methods and properties of a class in the order of their definition."""
    for member, target in vars(kind).items():
        if member.startswith("_") or not inspect.getdoc(target):
            continue
        if isinstance(target, classmethod | staticmethod):
            target = target.__func__
        if inspect.isfunction(target) or isinstance(target, property | cached_property):
            yield _entry(f"{name}.{member}", target)


def _signature(function: Callable[..., Any]) -> str:
    parts, keywords = [], False
    for parameter in inspect.signature(function).parameters.values():
        if parameter.name in ("self", "cls"):
            continue
        if parameter.kind is parameter.KEYWORD_ONLY and not keywords:
            keywords = True
            parts.append("*")
        default = "" if parameter.default is parameter.empty else f" = {parameter.default!r}"
        parts.append(f"{parameter.name}: {parameter.annotation}{default}")
    returned = inspect.signature(function).return_annotation
    listed = "".join(f"\n    {part}," for part in parts) + "\n" if parts else ""
    return f"({listed}) -> {returned}"


def _docstring(text: str) -> tuple[str, dict[str, list[tuple[str, str]]]]:
    """Split a docstring into its text and its sections."""
    sections: dict[str, list[tuple[str, str]]] = {}
    lines: list[str] = []
    title = None
    for line in text.splitlines():
        if match := SECTION.match(line):
            title = match[1]
            sections[title] = []
        elif title is None:
            lines.append(line)
        elif line.strip():
            _add(sections[title], line, named=title != "Returns")
    return _markdown("\n".join(lines).strip()), {
        title: [(name, _markdown(entry)) for name, entry in items]
        for title, items in sections.items()
    }


def _add(items: list[tuple[str, str]], line: str, *, named: bool) -> None:
    """Add a line to a section, as a new item or as the continuation of the last one."""
    is_new = line.startswith("    ") and not line.startswith("     ")
    name, colon, entry = line.strip().partition(": ")
    if named and is_new and colon:
        items.append((name, entry))
    elif not items:
        items.append(("", line.strip()))
    else:
        name, entry = items[-1]
        items[-1] = (name, f"{entry} {line.strip()}")


def _markdown(text: str) -> str:
    return ROLE.sub(r"`\1`", text).replace("``", "`")


if __name__ == "__main__":
    sys.exit(run_entry(main))
