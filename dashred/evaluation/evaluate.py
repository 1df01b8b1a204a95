"""Evaluate dashred on truths of other solvers: ``dashred evaluate foreign run tag=NAME``.

The cases follow from the hash of a tagged commit. Each is analysed by a process without access to
its truth, frozen and scored, and stored as one row. The page is written from all rows.
"""

from __future__ import annotations

from dashred.core.errors import DONE, OUR_FAILURE


def main(argv: list[str]) -> int:
    """List the cases of a draw, run those that are not done, or write the page."""
    from dashred.evaluation.foreign.arguments import read_words

    request = read_words(argv)

    # Imported late, after the arguments have been checked: SciPy and torch take seconds to import.
    if request.action == "document":
        from dashred.evaluation.foreign.document import write_document

        write_document(request)
        return DONE
    from dashred.evaluation.foreign.plan import plan, print_plan

    cases = plan(request)
    if request.action == "plan":
        print_plan(request, cases)
        return DONE
    from dashred.evaluation.foreign.run import run_foreign

    rows = run_foreign(request, cases)
    return OUR_FAILURE if any(row["outcome"] == "no-answer" for row in rows) else DONE
