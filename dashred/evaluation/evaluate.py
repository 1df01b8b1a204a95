"""Evaluate dashred: ``dashred evaluate foreign run tag=NAME``, and other tables.

`foreign` has truths of other solvers. The cases follow from the hash of a tagged commit. Each is
analysed by a process without access to its truth, frozen and scored, and stored as one row. The
page is written from all rows. `programs` analyses the bundled systems behind a function,
`estimators` compares the estimators for real time with a filter on the true law, and `networks`
compares the assimilation with dynamics with SHRED.
"""

from __future__ import annotations

from dashred.core.errors import DONE, OUR_FAILURE


def main(argv: list[str]) -> int:
    """Run a benchmark, or write its page."""
    others = {"programs": _programs, "estimators": _estimators, "networks": _networks}
    return others.get(argv[0] if argv else "", _foreign)(argv)


def _programs(argv: list[str]) -> int:
    """Run the rows that are not done, or write the page."""
    from dashred.evaluation.programs.arguments import read_words

    request = read_words(argv)
    if request.action == "document":
        from dashred.evaluation.case_rows import write_table
        from dashred.evaluation.programs.document import document

        write_table(request.output, request.document, document)
        return DONE
    from dashred.evaluation.programs.run import run_programs

    run_programs(request)
    return DONE


def _estimators(argv: list[str]) -> int:
    """Run the rows that are not done, or write the page."""
    from dashred.evaluation.estimators.arguments import read_words

    request = read_words(argv)
    if request.action == "document":
        from dashred.evaluation.case_rows import write_table
        from dashred.evaluation.estimators.document import document

        write_table(request.output, request.document, document)
        return DONE
    from dashred.evaluation.estimators.run import run_estimators

    run_estimators(request)
    return DONE


def _networks(argv: list[str]) -> int:
    """Run the rows that are not done, or write the page."""
    from dashred.evaluation.networks.arguments import read_words

    request = read_words(argv)
    if request.action == "document":
        from dashred.evaluation.case_rows import write_table
        from dashred.evaluation.networks.document import document

        write_table(request.output, request.document, document)
        return DONE
    from dashred.evaluation.networks.run import run_networks

    run_networks(request)
    return DONE


def _foreign(argv: list[str]) -> int:
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
