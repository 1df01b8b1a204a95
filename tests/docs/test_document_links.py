"""What the documents point to is there: files of the repository, and links between the pages."""

from __future__ import annotations

import re
from pathlib import Path

import pytest

CHECKOUT = Path(__file__).resolve().parents[2]
DOCUMENTS = [CHECKOUT / "README.md", *sorted((CHECKOUT / "docs").glob("*.md"))]
LINK = re.compile(r"\]\((?!https?:)([^)#\s]+)")
SOURCE = re.compile(r"`((?:dashred|callbacks|datamodules|tests|conf)/[\w/.-]+\.(?:py|yaml))`")
IN_DISCOVERY = re.compile(r"`(\w+\.py)`")


@pytest.mark.parametrize("document", DOCUMENTS, ids=lambda path: path.name)
def test_links_lead_somewhere(document: Path) -> None:
    text = document.read_text(encoding="utf-8")
    links = [document.parent / link for link in LINK.findall(text)]
    sources = [CHECKOUT / source for source in SOURCE.findall(text)]
    assert [path for path in links + sources if not path.exists()] == []


def test_the_method_names_files_of_discovery_that_are_there() -> None:
    text = (CHECKOUT / "docs" / "method.md").read_text(encoding="utf-8")
    named = set(IN_DISCOVERY.findall(text))
    assert len(named) > 10
    there = {path.name for path in (CHECKOUT / "dashred" / "discovery").iterdir()}
    assert named <= there
