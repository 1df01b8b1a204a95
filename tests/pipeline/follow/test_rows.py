"""Rows are written whole, or not at all."""

from __future__ import annotations

import errno
import json
import math
import os
from pathlib import Path

import pytest

from dashred.core.system_errors import describe_system_error
from dashred.pipeline.follow.rows import Rows

COLUMNS = ["time", "a.filter", "flag"]


def test_rows_of_csv(tmp_path: Path) -> None:
    with Rows(tmp_path / "o.csv", COLUMNS) as rows:
        rows.write([([0.1 + 0.2, 1 / 3], [""]), ([1.0, math.nan], ['say "x", y'])])
    assert (tmp_path / "o.csv").read_text().splitlines() == [
        "time,a.filter,flag",
        "0.30000000000000004,0.3333333,",
        '1.0,,"say ""x"", y"',
    ]


def test_rows_of_json(tmp_path: Path) -> None:
    with Rows(tmp_path / "o.jsonl", COLUMNS) as rows:
        rows.write([([1.0, math.nan], ["late"])])
    [line] = (tmp_path / "o.jsonl").read_text().splitlines()
    assert json.loads(line) == {"time": 1.0, "a.filter": None, "flag": "late"}


def test_a_full_disk_leaves_whole_rows(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    path, real = tmp_path / "o.csv", os.write
    with Rows(path, COLUMNS) as rows:
        rows.write([([1.0, 2.0], [""])])
        complete = path.read_bytes()
        calls = iter([5])

        def full(descriptor: int, data: memoryview) -> int:
            for count in calls:
                return real(descriptor, data[:count])
            raise OSError(errno.ENOSPC, os.strerror(errno.ENOSPC))

        monkeypatch.setattr(os, "write", full)
        with pytest.raises(OSError) as found:
            rows.write([([3.0, 4.0], [""])])
    monkeypatch.undo()
    assert path.read_bytes() == complete
    said = describe_system_error(found.value)
    assert said is not None and str(path) in said and "No space left" in said
