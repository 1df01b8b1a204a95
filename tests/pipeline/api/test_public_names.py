"""``import dashred`` is quick, and shows what there is."""

from __future__ import annotations

import subprocess
import sys

import pytest

import dashred

PROGRAM = """\
import sys, time
began = time.perf_counter()
import dashred
print(time.perf_counter() - began)
print(*(name for name in ("torch", "numpy", "mlflow", "xarray") if name in sys.modules))
"""


def test_the_import_is_quick_and_brings_no_library() -> None:
    words = [sys.executable, "-c", PROGRAM]
    ended = subprocess.run(words, capture_output=True, text=True, check=True)
    seconds, libraries = ended.stdout.splitlines()
    assert float(seconds) < 0.3
    assert libraries == ""


def test_every_public_name_is_there() -> None:
    assert set(dashred.__all__) <= set(dir(dashred))
    for name in dashred.__all__:
        assert getattr(dashred, name) is not None
    assert isinstance(dashred.__version__, str)


def test_another_name_is_none() -> None:
    with pytest.raises(AttributeError, match="has no attribute 'Solver'"):
        dashred.Solver  # noqa: B018


def test_the_analysis_loads_nothing_that_knows_a_truth() -> None:
    program = "import sys, dashred.pipeline.worker; from dashred import Problem, Result, load; "
    program += "print([name for name in sys.modules if name.startswith('dashred.evaluation')])"
    words = [sys.executable, "-c", program]
    ended = subprocess.run(words, capture_output=True, text=True, check=True)
    assert ended.stdout == "[]\n"
