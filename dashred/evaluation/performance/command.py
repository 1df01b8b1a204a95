"""Measure run time and memory, and write the page: ``dashred benchmark``.

Each row is measured in a process of its own and stored. After an interruption, the same command
measures the rows that are missing. The page is written from all rows of the folder.
"""

from __future__ import annotations

from dashred.core.errors import DONE, OUR_FAILURE


def main(argv: list[str]) -> int:
    """Measure the missing rows and write the page; return 1 if a row failed."""
    from dashred.evaluation.performance.arguments import read_words

    request = read_words(argv)

    # Imported late, after the arguments have been checked: SciPy takes a second to import.
    from dashred.evaluation.performance.document import write_document
    from dashred.evaluation.performance.run import measure_rows

    failed = measure_rows(request)
    write_document(request)
    return OUR_FAILURE if failed else DONE
