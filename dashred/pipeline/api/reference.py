"""The page of the Python API: ``python -m dashred.pipeline.api.reference path=docs/api.md``."""

from __future__ import annotations

import inspect
import re
import sys
from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path
from typing import Any

from dashred.core.argument_types import read_path
from dashred.core.arguments import Command, argument
from dashred.core.errors import DONE, run_entry
from dashred.core.files.atomic import write_text_atomic
from dashred.core.templates import render

TEMPLATE = "pipeline/api/templates/api.md.j2"
ORDER = ("Problem", "Result", "Simulator", "Plots", "Check", "record", "load", "InputError")
SECTION = re.compile(r"^(Args|Attributes|Returns|Raises):$")
# A role of Sphinx: :meth:`from_yaml`.
ROLE = re.compile(r":\w+:`~?([^`]+)`")


@dataclass(frozen=True)
class Entry:
    """One object, as the page shows it.

    Attributes:
        name: with its class: ``Problem.discover``.
        signature: its arguments with their types and defaults; empty for what is not called.
        text: paragraphs, in Markdown.
        sections: by title, ``(name, what it is)``; of a plain text the name is empty.
        members: of a class.
    """

    name: str
    signature: str
    text: str
    sections: dict[str, list[tuple[str, str]]]
    members: list[Entry]


@dataclass(frozen=True, kw_only=True)
class Arguments:
    """The words of the command."""

    path: Path = argument(read_path, "FILE.md", "file to write")


COMMAND = Command(
    "python -m dashred.pipeline.api.reference", Arguments, "Writes the page of the Python API."
)


def main(argv: list[str]) -> int:
    """Write the page."""
    path = COMMAND.read(argv).path
    # The package itself: it alone knows all public names, and imports them when they are used.
    package = sys.modules["dashred"]
    write_text_atomic(path, page(vars_of(package)))
    print(f"{path} is written")
    return DONE


def vars_of(package: object) -> dict[str, Any]:
    """Return the public objects of the package by name, in the page's order."""
    return {name: getattr(package, name) for name in ORDER}


def page(public: Mapping[str, Any]) -> str:
    """Return the page, in Markdown."""
    return render(TEMPLATE, entries=[_entry(name, found) for name, found in public.items()])


def _entry(name: str, found: Any) -> Entry:
    text, sections = _docstring(inspect.getdoc(found) or "")
    members = list(_members(name, found)) if inspect.isclass(found) else []
    signature = _signature(found) if inspect.isfunction(found) else ""
    return Entry(name, signature, text, sections, members)


def _members(name: str, kind: type) -> Iterator[Entry]:
    """Yield the public methods and properties of a class, in the order of its code."""
    for member, found in vars(kind).items():
        if member.startswith("_") or not inspect.getdoc(found):
            continue
        if isinstance(found, classmethod | staticmethod):
            found = found.__func__
        if inspect.isfunction(found) or isinstance(found, property | cached_property):
            yield _entry(f"{name}.{member}", found)


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
    """Take a docstring apart into its text and its sections."""
    sections: dict[str, list[tuple[str, str]]] = {}
    lines: list[str] = []
    title = None
    for line in text.splitlines():
        if found := SECTION.match(line):
            title = found[1]
            sections[title] = []
        elif title is None:
            lines.append(line)
        elif line.strip():
            _add(sections[title], line, named=title != "Returns")
    return _markdown("\n".join(lines).strip()), {
        title: [(name, _markdown(told)) for name, told in items]
        for title, items in sections.items()
    }


def _add(items: list[tuple[str, str]], line: str, *, named: bool) -> None:
    """Add a line of a section: a new item, or more of the last one."""
    begins = line.startswith("    ") and not line.startswith("     ")
    name, colon, told = line.strip().partition(": ")
    if named and begins and colon:
        items.append((name, told))
    elif not items:
        items.append(("", line.strip()))
    else:
        name, told = items[-1]
        items[-1] = (name, f"{told} {line.strip()}")


def _markdown(text: str) -> str:
    return ROLE.sub(r"`\1`", text).replace("``", "`")


if __name__ == "__main__":
    sys.exit(run_entry(main))
