"""Run many twin experiments and tabulate them: ``dashred bench systems=rde``.

Each row is one experiment: a system, a twin, a seed, a noise. Rows that are done are not run
again, so that a bench which was cut short goes on where it stopped.
"""

from __future__ import annotations


def main(argv: list[str]) -> int:
    """Run the rows that are not done, and print the table of all of them."""
    from dashred.evaluation.benchmark.arguments import read_words
    from dashred.evaluation.benchmark.plan import plan

    request = read_words(argv)
    rows = plan(request)

    # Whatever can be wrong with the words has been met by here: MLflow takes seconds to import.
    from dashred.evaluation.benchmark.run import run_bench

    return run_bench(request, rows)
