"""Devices, strategy and precision of the networks are refused where they contradict each other."""

from __future__ import annotations

from pathlib import Path

import pytest

from dashred.config import Config, load_config
from dashred.config.network_devices import accelerator, process_count
from dashred.core.errors import InputError


def config(quick: Path, *words: str) -> Config:
    return load_config([f"conf={quick}", *words], entry="train")


@pytest.mark.parametrize(
    ("words", "what", "hint"),
    [
        (["strategy=ddp"], "ddp starts the whole analysis once for each device", "ddp_spawn"),
        (["strategy=fsdp_cpu_offload"], "starts the whole analysis once", "ddp_spawn"),
        (["strategy=ddp_fork"], "ddp_fork copies a running analysis", "ddp_spawn"),
        (["strategy=ddp_spwn"], "unknown strategy 'ddp_spwn'", "ddp_spawn"),
        (["accelerator=tpu"], "must be one of: cpu, gpu, or null; got 'tpu'", None),
        (["precision=16-true"], "must be one of: 32-true, bf16-mixed, 16-mixed, or null", None),
        (["precision=16-mixed"], "16-mixed needs a GPU", "bf16-mixed"),
        (["devices=0"], "trainer.devices must be at least 1", None),
        (["devices=9"], "shred.batch=8 cannot be shared among 9 devices", "at most 8 devices"),
    ],
)
def test_what_cannot_be_is_one_message(quick: Path, words, what, hint) -> None:
    with pytest.raises(InputError) as caught:
        config(quick, *(f"trainer.{word}" for word in words))
    assert what in caught.value.what
    assert caught.value.where == "command line"
    assert hint is None or hint in (caught.value.hint or "")


@pytest.mark.parametrize(
    ("device", "word", "what"),
    [
        ("cuda", "accelerator=cpu", "device=cuda and trainer.accelerator=cpu contradict"),
        ("cuda:1", "devices=2", "device=cuda:1 names one GPU"),
        ("cuda:1", "strategy=ddp_spawn", "device=cuda:1 names one GPU"),
    ],
)
def test_device_and_trainer_may_not_contradict_each_other(quick: Path, device, word, what) -> None:
    with pytest.raises(InputError, match=what):
        config(quick, f"device={device}", f"trainer.{word}")


@pytest.mark.parametrize(
    ("words", "kind", "count"),
    [
        ([], "cpu", None),
        (["device=cuda:1"], "gpu", None),
        (["trainer.accelerator=gpu"], "gpu", None),
        (["trainer.devices=1"], "cpu", None),
        (["trainer.devices=2"], "cpu", 2),
        (["device=cuda", "trainer.devices=4", "trainer.precision=16-mixed"], "gpu", 4),
        (["trainer.strategy=ddp_spawn"], "cpu", 1),
    ],
)
def test_devices_of_the_networks(quick: Path, words, kind, count) -> None:
    found = config(quick, *words)
    assert (accelerator(found), process_count(found)) == (kind, count)
