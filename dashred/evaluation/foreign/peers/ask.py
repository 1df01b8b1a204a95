"""Ask the other methods about a case, each in a process of its own with a time limit."""

from __future__ import annotations

import json
import os
import subprocess
import sys
import tempfile
import time
from pathlib import Path
from typing import Any

from dashred.core.job_control import last_line
from dashred.evaluation.foreign.cases.case import Case, MadeCase
from dashred.evaluation.foreign.cases.case_files import read_simulator, write_case
from dashred.evaluation.foreign.peers.full_state import write_full_state
from dashred.evaluation.foreign.peers.methods import KINDS, asked_about, versions_of
from dashred.evaluation.foreign.peers.true_form import write_true_form
from dashred.evaluation.foreign.rows import PeerRow
from dashred.evaluation.foreign.scoring.compare_law import is_exact

LOG = "log.txt"


def is_asked(case: Case) -> bool:
    """Return whether the other methods can answer a case: they name a law, or none."""
    return case.kind in KINDS


def ask_peers(case: Case, made: MadeCase, limit: float) -> dict[str, PeerRow]:
    """Return the answers of all methods that apply to the system of a case.

    Args:
        case: the case.
        made: its recording and its truth; a method with the full state gets the states with noise.
        limit: seconds for each method.
    """
    with tempfile.TemporaryDirectory(prefix="dashred-peers-") as name:
        folder = Path(name)
        write_case(folder, made)
        axes = len(made.system.get("axes", {}))
        write_full_state(folder, made.truth, case.noise, case.analysis_seed)
        write_true_form(folder, made.truth)
        asked = asked_about(axes, made.truth)
        return {method: _ask(method, folder, made, limit) for method in asked}


def _ask(method: str, folder: Path, made: MadeCase, limit: float) -> PeerRow:
    command = [sys.executable, "-m", "dashred.evaluation.foreign.peers.run", method, str(folder)]
    began = time.perf_counter()
    try:
        ended = subprocess.run(
            command,
            env=os.environ | {"OMP_NUM_THREADS": "1"},
            capture_output=True,
            text=True,
            timeout=limit,
        )
    except subprocess.TimeoutExpired:
        return _no_answer(method, f"no answer within {limit:g} s", limit)
    seconds = time.perf_counter() - began
    answer = folder / f"{method}.json"
    if ended.returncode or not answer.is_file():
        (folder / LOG).write_text(ended.stderr, encoding="utf-8")
        problem = last_line(folder / LOG) or f"exit code {ended.returncode}"
        return _no_answer(method, problem, seconds)
    terms = json.loads(answer.read_text(encoding="utf-8"))["terms"]
    return PeerRow(
        right=_is_right(folder, terms, made),
        told=_told(terms),
        seconds=seconds,
        problem=None,
        versions=versions_of(method),
    )


def _is_right(folder: Path, terms: list[dict[str, Any]], made: MadeCase) -> bool:
    if made.truth.kind == "nothing":
        return not terms
    return is_exact(read_simulator(folder), terms, made.truth)


def _told(terms: list[dict[str, Any]]) -> str:
    shown = [f"{t['equation']}: {t['coefficient']:+.3g}·{t['term']}" for t in terms[:6]]
    return "; ".join(shown) + (f"; {len(terms) - 6} more" if len(terms) > 6 else "")


def _no_answer(method: str, problem: str, seconds: float) -> PeerRow:
    return PeerRow(
        right=None, told="", seconds=seconds, problem=problem, versions=versions_of(method)
    )
