"""The folder of a run for arrays that do not fit into memory."""

from __future__ import annotations

from pathlib import Path
from types import SimpleNamespace

import pytest

from dashred.core.errors import InputError
from dashred.core.files.scratch import Scratch


def scratch_in(folder: Path) -> Scratch:
    return Scratch(folder / "scratch", lambda: "run")


def use(scratch: Scratch) -> Path:
    folder = scratch.folder("ensemble")
    folder.mkdir(exist_ok=True)
    (folder / "states").write_bytes(bytes(100))
    return folder


def test_it_exists_only_while_it_is_used(tmp_path: Path) -> None:
    scratch = scratch_in(tmp_path)
    with scratch.removed_at_the_end():
        assert not scratch.root.exists()
        use(scratch)
        assert scratch.root.exists()
    assert not scratch.root.exists()


def test_an_error_removes_it_and_an_interruption_keeps_it(tmp_path: Path) -> None:
    scratch = scratch_in(tmp_path)
    with pytest.raises(InputError), scratch.removed_at_the_end():
        use(scratch)
        raise InputError("wrong")
    assert not scratch.root.exists()
    with pytest.raises(KeyboardInterrupt), scratch.removed_at_the_end():
        kept = use(scratch)
        raise KeyboardInterrupt
    assert (kept / "states").exists()
    # The next run uses it, and removes it.
    again = scratch_in(tmp_path)
    with again.removed_at_the_end():
        assert (again.folder("ensemble") / "states").exists()
    assert not again.root.exists()


def test_a_run_that_does_not_use_it_leaves_that_of_another(tmp_path: Path) -> None:
    other = scratch_in(tmp_path)
    with other.removed_at_the_end():
        use(other)
        with scratch_in(tmp_path).removed_at_the_end():
            pass
        assert other.root.exists()


def test_two_runs_do_not_share_it(tmp_path: Path) -> None:
    first, second = scratch_in(tmp_path), scratch_in(tmp_path)
    with first.removed_at_the_end():
        use(first)
        with pytest.raises(InputError, match="another analysis is running in this folder"):
            second.folder("ensemble")


def test_a_disk_that_is_too_small_is_refused(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    scratch = scratch_in(tmp_path)
    monkeypatch.setattr("dashred.core.files.scratch.MARGIN", 0)
    usage = SimpleNamespace(free=1000)
    monkeypatch.setattr("dashred.core.files.scratch.shutil.disk_usage", lambda path: usage)
    scratch.check_space(1000)
    with pytest.raises(InputError, match="on disk, but only") as error:
        scratch.check_space(1001)
    assert error.value.where == str(scratch.root) and "output=DIR" in str(error.value.hint)
    # What is written of it already is not needed again.
    with scratch.removed_at_the_end():
        use(scratch)
        scratch.check_space(1001)
