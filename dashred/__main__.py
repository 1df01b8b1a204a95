"""All commands: ``dashred COMMAND key=value ...``, or ``python -m dashred COMMAND ...``."""

from __future__ import annotations

import sys
from importlib import import_module
from typing import NamedTuple

from dashred.core.command_line.entry import run_entry
from dashred.core.errors import DONE, WRONG_INPUT, InputError, nearest


class Entry(NamedTuple):
    """A command: the module with its ``main``, and its description."""

    module: str
    help: str


ANALYSIS = {
    "init": Entry("dashred.pipeline.init.command", "write a first configuration for a recording"),
    "check": Entry("dashred.pipeline.check.command", "find mistakes in the input within seconds"),
    "train": Entry("dashred.train", "find what a simulation leaves out; resume=RUN_ID resumes"),
    "follow": Entry(
        "dashred.pipeline.follow.command", "follow a stream of readings with the results of a run"
    ),
    "fetch": Entry("dashred.data.io.fetch", "fetch the recording of a real pendulum"),
    "reference": Entry("dashred.config.reference_command", "print every configuration key"),
}
EVIDENCE = {
    "benchmark": Entry(
        "dashred.evaluation.performance.command", "measure how run time and memory grow"
    ),
    "bench": Entry("dashred.evaluation.bench", "run many twin experiments and tabulate them"),
    "compare": Entry("dashred.evaluation.compare", "compare dashred with other methods on twins"),
    "prove": Entry("dashred.evaluation.prove", "analyse random cases with hidden truths"),
    "evaluate": Entry("dashred.evaluation.evaluate", "test other solvers' systems, and parts"),
    "publish": Entry("dashred.evaluation.publish", "publish cases without their truths"),
    "record": Entry("dashred.evaluation.twins.record_command", "record a twin with a hidden truth"),
    "score": Entry("dashred.evaluation.twins.score_command", "score findings against the truth"),
}
COMMANDS = ANALYSIS | EVIDENCE


def usage() -> str:
    """Return the text of ``dashred --help``."""
    groups = {"Analyse a recording": ANALYSIS, "Evaluate the method, in a checkout": EVIDENCE}
    lines = ["usage: dashred COMMAND [key=value ...]", "       dashred COMMAND --help"]
    lines.append("       dashred --version")
    for title, group in groups.items():
        lines += ["", f"{title}:", *(f"  {name:<10} {entry.help}" for name, entry in group.items())]
    return "\n".join(lines) + "\n"


def main(argv: list[str]) -> int:
    """Run the command that the first argument names, with the other arguments."""
    if not argv or argv[0] in ("--help", "-h"):
        print(usage(), end="")
        return DONE if argv else WRONG_INPUT
    name, *arguments = argv
    if name == "--version":
        from importlib.metadata import version

        print(version("dashred"))
        return DONE
    if name not in COMMANDS:
        hint = f"dashred train {name}" if "=" in name else nearest(name, COMMANDS)
        raise InputError(f"there is no command {name!r}", where="command line", hint=hint)
    return int(import_module(COMMANDS[name].module).main(arguments))


def run() -> int:
    """Run the command line of this process; return its exit code."""
    return run_entry(main)


if __name__ == "__main__":
    sys.exit(run())
