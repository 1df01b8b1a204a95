"""What a run leaves behind about itself: commit, host, seconds, tags, the printed summary."""

from __future__ import annotations

import logging
import platform
import subprocess
import warnings
from collections.abc import Iterable, Mapping
from pathlib import Path

import torch
from threadpoolctl import threadpool_limits

from dashred.config import Config
from dashred.config.bundled_systems import INSTALLED, PACKAGE
from dashred.core.files.atomic import write_text_atomic
from dashred.core.findings.findings import sha256_of, write_json_atomic
from dashred.core.findings.schema import Findings
from dashred.core.mlflow.tracker import Tracker
from dashred.core.threads import use_threads
from dashred.models.device import check_device
from dashred.pipeline.run.output_dir import results_in
from dashred.pipeline.run.run_manifest import FROZEN
from dashred.reporting.text.summary import print_summary, summary


def prepare_torch(config: Config) -> None:
    """Set threads and determinism, and refuse a device that is not there.

    Raises:
        InputError: this machine has no such device.
    """
    use_threads(config.threads)
    # Arrays here are too small to share; on a busy machine torch's threads, and those of NumPy's
    # linear algebra, would spend their time waiting for each other. And with more than one, the LU
    # of a batch of matrices that are larger than 150 is wrong in torch 2.13 with MKL 2024.2: one of
    # 200 was off by 1e14, without an error, or hung.
    torch.set_num_threads(1)
    threadpool_limits(1)
    torch.use_deterministic_algorithms(True, warn_only=True)
    # Lightning advertises, and speaks of GPUs that nobody asked for; our stages tell the story.
    logging.getLogger("lightning.pytorch").setLevel(logging.ERROR)
    # Lightning still reads a torch class that torch deprecates: nothing a user could act on.
    warnings.filterwarnings("ignore", message=".*LeafSpec.*", category=FutureWarning)
    check_device(config)


def git_commit() -> str:
    """Return the commit of dashred's own checkout, with ``+`` if it has changes, or ``unknown``.

    An installed package, or a copy that lies in another repository, has no commit.
    """
    if INSTALLED:
        return "unknown"
    root = PACKAGE.parent
    commands = (
        ["git", "rev-parse", "--show-toplevel", "HEAD"],
        ["git", "status", "--porcelain", "-uno"],
        ["git", "ls-files", "--error-unmatch", f"{PACKAGE.name}/__init__.py"],
    )
    try:
        answer, changes, _ = (
            subprocess.run(
                command, cwd=root, capture_output=True, text=True, check=True, timeout=10
            ).stdout.strip()
            for command in commands
        )
    except (OSError, subprocess.SubprocessError):
        return "unknown"
    place, commit = answer.rsplit("\n", 1)
    return commit + ("+" if changes else "") if Path(place) == root else "unknown"


def write_record(output: Path, seconds: dict[str, float], more: Mapping[str, str]) -> None:
    """Write ``run.json``: how long the stages took, and where and by which code they ran."""
    record = {
        "seconds": {title: float(f"{value:.3g}") for title, value in seconds.items()},
        "host": platform.node(),
        "git_commit": git_commit(),
        **more,
    }
    write_json_atomic(output / "run.json", record)


def write_summary(output: Path, findings: Findings, paths: Mapping[str, Path | str]) -> str:
    """Write ``summary.txt``; returns what it says."""
    text = summary(findings, None, paths)
    write_text_atomic(output / "summary.txt", text)
    return text


def finish(
    run: Tracker,
    output: Path,
    findings: Findings,
    figures: Iterable[Path],
    seconds: dict[str, float],
    config_sha256: str,
) -> None:
    """Write ``run.json``, log what this run has written and no other file, print the summary."""
    run.set_tags({"config sha256": config_sha256})
    text = write_summary(output, findings, {"findings": output, "MLflow store": run.uri})
    write_record(output, seconds, {"mlflow_run": run.run_id})
    run.log_files([*results_in(output), *figures])
    run.set_tags({FROZEN: sha256_of(output / "findings.json")})
    print_summary(text)
