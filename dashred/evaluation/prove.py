"""Test the analysis on sealed cases: ``dashred prove cases=120 nulls=100``.

Each case is drawn, recorded, analysed by a process without access to the truth, frozen, opened and
scored. The last step writes the document.
"""

from __future__ import annotations

from dashred.core.errors import DONE, OUR_FAILURE


def main(argv: list[str]) -> int:
    """Run the unfinished cases, or rescore an existing draw, and write the document."""
    from dashred.evaluation.proof.arguments import read_words

    request = read_words(argv)

    # Imported late, after the arguments have been checked: torch takes seconds to import.
    from dashred.evaluation.proof.conclude import conclude
    from dashred.evaluation.proof.run import run_proof
    from dashred.evaluation.proof.scoring.rescore import rescore

    stored = run_proof(request) if request.scored_by is None else rescore(request)
    conclude(request, stored)
    return OUR_FAILURE if any(case.record["problem"] for case in stored) else DONE
