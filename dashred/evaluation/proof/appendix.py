"""The appendix: the analysis of a real pendulum, whose truth is unknown."""

from __future__ import annotations

import tempfile
from pathlib import Path

from dashred.core.errors import DONE, InputError
from dashred.core.findings.findings import check_freeze
from dashred.core.templates import render
from dashred.evaluation.isolation.worker import LIMIT, isolated_copy, worker
from dashred.evaluation.twins.findings_reader import read_findings
from dashred.pipeline.run.output_dir import make_output
from dashred.reporting.text.verdict import verdict_lines

FOLDER = "real-pendulum"


def analyse_pendulum(recording: Path, output: Path) -> str:
    """Analyse the recording, or read its existing findings; return the appendix.

    Raises:
        InputError: the recording cannot be analysed.
    """
    folder = make_output(str(output / FOLDER))
    if not (folder / "findings.json").is_file():
        with tempfile.TemporaryDirectory(prefix="dashred-worker-") as copy:
            words = ["conf=pendulum", f"recording.path={recording}", f"output={folder}"]
            words += [f"tracking.root={output / 'mlruns'}", "tracking.experiment=proof"]
            with worker(isolated_copy(Path(copy))) as process:
                code, _ = process.analyse(words, folder / "log.txt", LIMIT)
        if code != DONE:
            raise InputError(
                "the recording of the pendulum could not be analysed",
                where=str(recording),
                hint=f"see {folder / 'log.txt'}",
            )
    check_freeze(folder)
    return _appendix(folder)


def _appendix(folder: Path) -> str:
    findings = read_findings(folder)
    fit = findings["fit"]
    return render(
        "evaluation/proof/templates/appendix.md.j2",
        verdict="\n".join(verdict_lines(findings)),
        restarted=_compare_errors(fit["heldout_restarted"]),
        free_run=_compare_errors(fit["heldout_time"]),
    )


def _compare_errors(errors: dict[str, float | None]) -> str:
    before, after = errors["simulation_refit"], errors["corrected"]
    if before is None or after is None:
        return "unknown"
    return f"{before:.3g} without the law, {after:.3g} with it ({before / after:.2g} times smaller)"
