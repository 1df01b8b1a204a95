"""Compare every method with the hidden truth: ``dashred compare systems=all``.

First runs the experiments of a benchmark, then the other methods on the same recordings. Finished
rows are not run again. Writes a document of all rows in the folder, ``docs/results.md``.
"""

from __future__ import annotations


def main(argv: list[str]) -> int:
    """Run the rows that are not done, and write the page of all of them."""
    from dashred.evaluation.benchmark.plan import plan
    from dashred.evaluation.comparison.arguments import read_words

    request = read_words(argv)
    rows = plan(request)

    # Whatever can be wrong with the words has been met by here: MLflow takes seconds to import.
    from dashred.evaluation.comparison.run import run_comparison

    return run_comparison(request, rows, request.document or request.output / "results.md")
