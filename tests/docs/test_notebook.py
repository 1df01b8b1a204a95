"""The notebook runs from its first cell to its last, wherever it lies, and was run as it stands."""

from __future__ import annotations

import warnings
from pathlib import Path
from typing import Any

import nbformat
import pytest

from tests.conftest import CHECKOUT

NOTEBOOK = CHECKOUT / "docs" / "notebook.ipynb"


def read() -> Any:
    return nbformat.read(NOTEBOOK, as_version=4)


def printed(notebook: Any) -> str:
    """Return all that the cells show as text."""
    outputs = [o for cell in notebook.cells for o in cell.get("outputs", [])]
    return "\n".join(o.get("text") or o.get("data", {}).get("text/plain", "") for o in outputs)


def test_it_was_executed_from_top_to_bottom() -> None:
    counts = [cell.execution_count for cell in read().cells if cell.cell_type == "code"]
    assert counts == list(range(1, len(counts) + 1))
    assert "Traceback" not in printed(read()) and "/work/" not in NOTEBOOK.read_text("utf-8")


@pytest.mark.slow
def test_it_runs_without_the_real_recording(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv("PYTHONPATH", str(CHECKOUT))
    # The notebook shows its figures by the inline backend.
    monkeypatch.delenv("MPLBACKEND", raising=False)
    monkeypatch.setenv("IPYTHONDIR", str(tmp_path / "ipython"))
    with warnings.catch_warnings():
        # Those of Jupyter's own code are nothing that we could act on.
        warnings.simplefilter("ignore")
        from nbclient import NotebookClient

        resources = {"metadata": {"path": str(tmp_path)}}
        notebook = NotebookClient(read(), timeout=1200, resources=resources).execute()
    found = printed(notebook)
    assert found.count("<dashred.Result missing-term") == 2
    assert "linear damping of temperature" in found
    assert "recording: the recording has no variable 'time'" in found
    pictures = [o for cell in notebook.cells for o in cell.get("outputs", []) if "data" in o]
    assert sum("image/png" in o["data"] for o in pictures) == 4
