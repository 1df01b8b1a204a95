"""Hold every method against the hidden truth: ``python -m dashred.evaluation.compare systems=all``.

First the experiments of a bench, then the other methods on the same recordings; rows that are done
are not done again. It ends in a page of all rows in the folder, ``docs/results.md``.
"""

from __future__ import annotations

import sys
from pathlib import Path

from dashred.core.errors import run_entry

USAGE = """\
usage: python -m dashred.evaluation.compare systems=SYSTEM,... [key=value ...]

Runs `python -m dashred.train` on every combination, as `python -m dashred.evaluation.bench` does, and then, on
the same recordings, the simulation, optimal interpolation, SHRED on plain simulations, ensemble
Kalman filters of the state and with coefficients, and PDE-FIND given the full noisy field. Rows
that are done are not done again: after an interruption, give the same command again.

  systems=all            the bundled systems ({bundled}),
                         some of them, or paths of YAML files
  twins=a,b,null         hidden truths; default: those that start from the simulator's own start
  seeds=0-2              default: 0
  noise=0.01,0.05        fraction of each field's standard deviation; default: 0.05
  sensors=own,4,8,20     fit sensors; default: own, the system's own number
  extra=own,0,4          of them, those that SHRED's input is without; default: own
  jobs=2                 rows at once; default: 1, so that nothing disturbs the seconds
  output=DIR             default: {output} (not tracked by git)
  document=FILE.md       the page, its figures in figures/ beside it; default: DIR/results.md
  key=value              overrides of every run: see python -m dashred.train --help

The page has every row that lies in DIR, those of earlier commands with the same overrides too, so
that systems with other seeds, or layouts, are other commands with the same output= and document=:

  python -m dashred.evaluation.compare systems=rde,heat seeds=0-2 output=DIR document=docs/results.md
  python -m dashred.evaluation.compare systems=ks2d seeds=0-1 output=DIR document=docs/results.md
  python -m dashred.evaluation.compare systems=rde,ks2d sensors=4,8,20,49 noise=0.01,0.05,0.1 twins=a \\
      output=DIR document=docs/results.md

A row that failed, and a method of one, are on the page, too. The command then ends with 1; given
again it tries again, but where a simulator is not resolved.
"""


def main(argv: list[str]) -> int:
    """Run the rows that are not done, and write the page of all of them."""
    from dashred.evaluation.benchmark.arguments import read_words
    from dashred.evaluation.benchmark.plan import plan

    named = [word.partition("=")[2] for word in argv if word.startswith("document=")]
    others = [word for word in argv if not word.startswith("document=")]
    request = read_words(others, "comparison", USAGE)
    rows = plan(request)
    document = Path(named[-1]) if named else request.output / "results.md"

    # Whatever can be wrong with the words has been met by here: MLflow takes seconds to import.
    from dashred.evaluation.comparison.run import run_comparison

    return run_comparison(request, rows, document.absolute())


if __name__ == "__main__":
    sys.exit(run_entry(main))
