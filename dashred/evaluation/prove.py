"""Prove it on cases whose truth is concealed: ``dashred prove cases=120 nulls=100``.

Each case is drawn and recorded, analysed by a process that has no way to the truth, frozen,
opened and scored; the last step writes all of it down.
"""

from __future__ import annotations

from dashred.core.errors import DONE, OUR_FAILURE


def main(argv: list[str]) -> int:
    """Run the cases that are not done, or score a kept draw again, and write the document."""
    from dashred.evaluation.proof.arguments import read_words

    request = read_words(argv)

    # Whatever can be wrong with the words has been met by here: torch takes seconds to import.
    from dashred.evaluation.proof.conclude import conclude
    from dashred.evaluation.proof.run import run_proof
    from dashred.evaluation.proof.scoring.rescore import rescore

    kept = run_proof(request) if request.scored_by is None else rescore(request)
    conclude(request, kept)
    return OUR_FAILURE if any(one.record["problem"] for one in kept) else DONE
