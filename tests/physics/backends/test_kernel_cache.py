"""Compiled kernels are kept for the next run, and a damaged or missing cache only costs time."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pytest

from dashred.physics.backends import kernel_cache
from dashred.physics.backends.input_signals import NO_INPUTS, InputSignals
from dashred.physics.backends.kernel_cache import kernels_kept
from dashred.physics.backends.numba_backend import ChannelTerm, _compile, compile_kernel
from dashred.physics.expressions.algebra import Name, Number, Power, Product

SIGNAL = InputSignals(np.linspace(0.0, 1.0, 3), {"drive": np.zeros(3)})


def compiled(value: float = 0.5, signals: InputSignals = NO_INPUTS) -> Any:
    """Compile a kernel ``value · x²`` as a new process would."""
    _compile.cache_clear()
    square = Product((Number(value), Power(Name("x"), Number(2.0))))
    return compile_kernel([ChannelTerm(0, square, None)], ["x"], [], (), signals)


def kept(folder: Path) -> list[Path]:
    """Return the files of machine code."""
    return sorted((folder / "__pycache__").glob("*.nbc"))


def test_a_kept_kernel_is_not_compiled_again(tmp_path: Path) -> None:
    with kernels_kept(tmp_path):
        assert compiled().cache_hits == 0
        assert compiled().cache_hits == 1
    assert len(kept(tmp_path)) == 1


def test_kernels_are_kept_only_where_it_is_asked_for(tmp_path: Path) -> None:
    with kernels_kept(tmp_path):
        pass
    assert compiled().cache_hits == 0
    assert not kept(tmp_path)


def test_other_code_is_another_kernel(tmp_path: Path) -> None:
    with kernels_kept(tmp_path):
        compiled(1.5)
        assert compiled(2.5).cache_hits == 0
    assert len(kept(tmp_path)) == 2


def test_a_kernel_that_reads_inputs_is_not_kept(tmp_path: Path) -> None:
    with kernels_kept(tmp_path):
        compiled(signals=SIGNAL)
    assert not list(tmp_path.iterdir())


def test_a_damaged_kernel_is_compiled_and_deleted(tmp_path: Path) -> None:
    with kernels_kept(tmp_path):
        compiled()
        [path] = kept(tmp_path)
        path.write_bytes(path.read_bytes()[:20])
        assert compiled().cache_hits == 0
        assert not kept(tmp_path)
        assert compiled().cache_hits == 0
        assert compiled().cache_hits == 1


def test_an_unusable_folder_costs_time_only(tmp_path: Path) -> None:
    (tmp_path / "file").write_text("not a folder")
    with kernels_kept(tmp_path / "file"):
        assert compiled().cache_hits == 0


def test_the_oldest_kernels_are_deleted(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(kernel_cache, "MOST_KERNELS", 2)
    with kernels_kept(tmp_path):
        for value in (1.5, 2.5, 3.5):
            compiled(value)
        assert len(kept(tmp_path)) == len(list(tmp_path.glob("*.py"))) == 2
        assert compiled(3.5).cache_hits == 1
        assert compiled(1.5).cache_hits == 0
