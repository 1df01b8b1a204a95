"""Run many twin experiments and tabulate them: ``dashred bench systems=rde``.

Each row is one experiment: a system, a twin, a seed and a noise. Finished rows are not run again:
an interrupted benchmark resumes where it stopped.
"""

from __future__ import annotations


def main(argv: list[str]) -> int:
    """Run the unfinished rows and print the table of all rows."""
    from dashred.evaluation.benchmark.arguments import read_words
    from dashred.evaluation.benchmark.plan import plan

    request = read_words(argv)
    rows = plan(request)

    # Imported late, after the arguments have been checked: MLflow takes seconds to import.
    from dashred.evaluation.benchmark.run import run_bench

    return run_bench(request, rows)
