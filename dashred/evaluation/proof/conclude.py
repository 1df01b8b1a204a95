"""Write the document, the figures and the records of a proof."""

from __future__ import annotations

from collections.abc import Sequence

from dashred.core.findings.findings import write_json_atomic
from dashred.core.progress import CONSOLE
from dashred.evaluation.proof.appendix import analyse_pendulum
from dashred.evaluation.proof.cases.case_store import StoredCase
from dashred.evaluation.proof.cases.draw import seed_of
from dashred.evaluation.proof.document import write_document
from dashred.evaluation.proof.figures import save_figures
from dashred.evaluation.proof.protocol import ProtocolFacts
from dashred.evaluation.proof.request import Request
from dashred.evaluation.proof.scoring.targets import TARGETS
from dashred.pipeline.run.output_dir import make_output


def conclude(request: Request, stored: Sequence[StoredCase]) -> None:
    """Write the document and print the targets."""
    records = [case.record for case in stored]
    facts = ProtocolFacts(
        commit=None if request.practice else request.draw,
        draw=request.draw,
        seed=seed_of(request.draw),
        cases=request.cases,
        nulls=request.nulls,
        hours=sum(case.wall for case in stored) / 3600 / request.jobs,
        processes=request.jobs,
        drawn_again=sum(case.draws - 1 for case in stored),
        scored_by=request.scored_by,
    )
    write_json_atomic(request.output / "records.json", {"records": records})
    make_output(str(request.document.parent))
    save_figures(records, request.document.parent / "figures")
    write_document(records, request.document, facts)
    if request.pendulum is not None:
        appendix = analyse_pendulum(request.pendulum, request.output)
        write_document(records, request.document, facts, appendix)
    for target in TARGETS:
        measured = target.measure(records)
        CONSOLE.print(
            f"{target.name}: {measured.value} ({target.outcome(measured)})",
            markup=False,
            soft_wrap=True,
        )
    CONSOLE.print(f"Document: {request.document}", markup=False, soft_wrap=True)
