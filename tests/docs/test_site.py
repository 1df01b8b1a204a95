"""The documentation builds as a site without a warning, and loads nothing from elsewhere."""

from __future__ import annotations

import os
import re
import subprocess
import sys
from pathlib import Path

CHECKOUT = Path(__file__).resolve().parents[2]
# What a browser would load on its own: scripts, images and style sheets of other servers.
LOADED = re.compile(r'<(?:script|img|iframe)[^>]*src="?https?:|<link[^>]*stylesheet[^>]*https?:')


def test_the_site_builds_strictly_and_is_self_contained(tmp_path: Path) -> None:
    command = [sys.executable, "-m", "mkdocs", "build", "--strict", "--quiet"]
    ended = subprocess.run(
        [*command, "--site-dir", str(tmp_path / "site")],
        cwd=CHECKOUT,
        env=os.environ | {"NO_MKDOCS_2_WARNING": "1"},
        capture_output=True,
        text=True,
        timeout=300,
    )
    assert ended.returncode == 0, ended.stderr
    pages = list((tmp_path / "site").rglob("*.html"))
    assert len(pages) > len(list((CHECKOUT / "docs").glob("*.md")))
    assert [page for page in pages if LOADED.search(page.read_text(encoding="utf-8"))] == []
