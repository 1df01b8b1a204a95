"""Fenced code blocks of a document."""

from __future__ import annotations

import re
from pathlib import Path

FENCE = re.compile(r"^( *)```(\w*)\n(.*?)^\1```$", re.MULTILINE | re.DOTALL)


def blocks(document: Path) -> list[tuple[str, str]]:
    """Return the language and the text of every fenced block of a document."""
    found = FENCE.findall(document.read_text(encoding="utf-8"))
    return [(language, body) for _, language, body in found]


def snippets(document: Path, language: str) -> list[str]:
    """Return the blocks of one language."""
    return [body for found, body in blocks(document) if found == language]
