"""Find what physics a simulation leaves out: ``dashred train conf=rde``.

The command analyses a recording (``recording.path=FILE``), runs a twin experiment
(``recording.twin=NAME``) or resumes a run (``resume=RUN_ID``). ``python -m dashred.train`` is the
same command. A twin experiment runs three processes: a recorder that knows the hidden truth, an
analysis that has the recording only, and a scorer that reads the truth after the findings are
frozen.
"""

from __future__ import annotations

import sys

from dashred.config import load_config
from dashred.config.checks.placeholders import refuse_unfinished_lines
from dashred.core.command_line.entry import run_entry
from dashred.core.errors import DONE
from dashred.core.mlflow.store_check import check_store


def main(argv: list[str]) -> int:
    """Run an analysis or a twin experiment, or resume an interrupted run."""
    is_help = {"--help", "-h"} & set(argv)
    if not is_help and any(word.startswith("resume=") for word in argv):
        from dashred.evaluation.twins.twin_experiment import score_resumed
        from dashred.pipeline.run.resume import resume

        return resume(argv, score_resumed)
    config = load_config(argv, entry="train")
    refuse_unfinished_lines(config)
    check_store(config.tracking.root, config.tracking.artifacts)
    if config.recording.twin is not None:
        from dashred.evaluation.twins.twin_experiment import run_twin

        return run_twin(config, argv)
    from dashred.pipeline.analyse import analyse

    analyse(config)
    return DONE


if __name__ == "__main__":
    sys.exit(run_entry(main))
