"""A run is refused at its start where its networks cannot be trained."""

from __future__ import annotations

import multiprocessing
import os
import sys
from pathlib import Path

import pytest
import torch

from dashred.config import load_config
from dashred.core.errors import InputError
from dashred.models import device
from dashred.models.device import check_device


def refused(quick: Path, *words: str) -> InputError:
    config = load_config([f"conf={quick}", *words], entry="train")
    with pytest.raises(InputError) as caught:
        check_device(config)
    return caught.value


@pytest.mark.parametrize(("there", "hint"), [(0, "accelerator=cpu"), (1, "at most 1")])
def test_more_gpus_than_there_are(quick: Path, monkeypatch, there: int, hint: str) -> None:
    monkeypatch.setattr(torch.cuda, "device_count", lambda: there)
    error = refused(quick, "trainer.accelerator=gpu", "trainer.devices=2")
    assert error.what == f"this machine has {there} CUDA devices, but the networks need 2"
    assert hint in (error.hint or "")


def test_a_processor_without_bfloat16(quick: Path, monkeypatch) -> None:
    monkeypatch.setattr(device, "trains_in_bfloat16", lambda: False)
    error = refused(quick, "trainer.precision=bf16-mixed")
    assert error.what == "this processor cannot train the networks in bfloat16"
    assert "precision=null" in (error.hint or "")


def test_more_processes_than_cpus(quick: Path, monkeypatch) -> None:
    monkeypatch.setattr(os, "cpu_count", lambda: 2)
    error = refused(quick, "trainer.devices=3")
    assert (error.what, error.where) == (
        "this machine has 2 CPUs, but the networks need 3",
        "command line",
    )


def test_an_interactive_shell_cannot_start_processes(quick: Path, monkeypatch) -> None:
    monkeypatch.setattr(os, "cpu_count", lambda: 2)
    monkeypatch.setattr(sys, "ps1", ">>> ", raising=False)
    assert "notebook" in refused(quick, "trainer.devices=2").what


def test_a_process_that_imports_the_script_does_not_start_the_analysis(
    quick: Path, monkeypatch
) -> None:
    monkeypatch.setattr(os, "cpu_count", lambda: 2)
    process = multiprocessing.current_process()
    monkeypatch.setattr(process, "_inheriting", True, raising=False)
    error = refused(quick, "trainer.devices=2")
    assert error.hint == 'put the analysis of the script under: if __name__ == "__main__":'


def test_one_device_needs_none_of_this(quick: Path, monkeypatch) -> None:
    monkeypatch.setattr(sys, "ps1", ">>> ", raising=False)
    check_device(load_config([f"conf={quick}"], entry="train"))
