"""What the documents point to is there: files of the repository, and links between the pages."""

from __future__ import annotations

import re
from pathlib import Path

import pytest

CHECKOUT = Path(__file__).resolve().parents[2]
DOCUMENTS = [CHECKOUT / "README.md", *sorted((CHECKOUT / "docs").glob("*.md"))]
LINK = re.compile(r"\]\((?!https?:)([^)#\s]+)")
SOURCE = re.compile(r"`((?:dashred|callbacks|datamodules|tests|conf)/[\w/.-]*)`")
METHOD = re.compile(r"docs/method\.md(?:#([\w-]+))?")
HEADING = re.compile(r"^#+ (.+)$", re.MULTILINE)


@pytest.mark.parametrize("document", DOCUMENTS, ids=lambda path: path.name)
def test_links_lead_somewhere(document: Path) -> None:
    text = document.read_text(encoding="utf-8")
    links = [document.parent / link for link in LINK.findall(text)]
    sources = [CHECKOUT / source for source in SOURCE.findall(text)]
    assert [path for path in links + sources if not path.exists()] == []


def test_the_method_names_the_files_that_hold_it() -> None:
    text = (CHECKOUT / "docs" / "method.md").read_text(encoding="utf-8")
    assert len(set(SOURCE.findall(text))) > 20


def test_the_code_refers_to_headings_of_the_method() -> None:
    text = (CHECKOUT / "docs" / "method.md").read_text(encoding="utf-8")
    anchors = {heading.lower().replace(" ", "-") for heading in HEADING.findall(text)}
    referred = {
        anchor
        for folder in ("dashred", "callbacks", "datamodules", "tests")
        for path in (CHECKOUT / folder).rglob("*.py")
        for anchor in METHOD.findall(path.read_text(encoding="utf-8"))
    }
    assert referred - {""} <= anchors
