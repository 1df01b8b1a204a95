"""Provenance of a run: commit, host, run times, tags, and the printed summary."""

from __future__ import annotations

import platform
import subprocess
from collections.abc import Iterable, Mapping
from pathlib import Path

from dashred.config import Config
from dashred.config.bundled_systems import IS_INSTALLED, PACKAGE
from dashred.core.files.atomic import write_text_atomic
from dashred.core.findings.findings import sha256_of, write_json_atomic
from dashred.core.findings.schema import Findings
from dashred.core.mlflow.tracker import Tracker
from dashred.core.work import work_done
from dashred.models.device import check_device
from dashred.models.torch_setup import set_up_torch
from dashred.pipeline.run.output_dir import results_in
from dashred.pipeline.run.run_manifest import FROZEN
from dashred.reporting.text.summary import print_summary, summary


def prepare_torch(config: Config) -> None:
    """Set threads and determinism, and check the device.

    Raises:
        InputError: the machine does not have the device.
    """
    set_up_torch(config.threads)
    check_device(config)


def git_commit() -> str:
    """Return the commit of the checkout, with ``+`` if files have changed, or ``unknown``.

    An installed package, or a copy inside another repository, has no commit.
    """
    if IS_INSTALLED:
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
    """Write ``run.json``: the seconds of the stages, the work, the host and the commit."""
    record = {
        "seconds": {title: float(f"{value:.3g}") for title, value in seconds.items()},
        "work": work_done(),
        "host": platform.node(),
        "git_commit": git_commit(),
        **more,
    }
    write_json_atomic(output / "run.json", record)


def write_summary(output: Path, findings: Findings, paths: Mapping[str, Path | str]) -> str:
    """Write ``summary.txt``; return its text."""
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
    """Write ``run.json``, log the files of this run and no others, and print the summary."""
    run.set_tags({"config sha256": config_sha256})
    text = write_summary(output, findings, {"findings": output, "MLflow store": run.uri})
    write_record(output, seconds, {"mlflow_run": run.run_id})
    run.log_files([*results_in(output), *figures])
    run.set_tags({FROZEN: sha256_of(output / "findings.json")})
    print_summary(text)
