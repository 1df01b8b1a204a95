"""What a run needs of memory and of disk space."""

from __future__ import annotations

from collections.abc import Iterator

from dashred.core.stated.memory import memory_text
from dashred.pipeline.check.context import CheckContext
from dashred.pipeline.check.remark import Remark
from dashred.pipeline.input.scratch_folder import scratch_of
from dashred.pipeline.simulation.ensemble_memory import MemoryPlan, bytes_on_disk, memory_of_run


def memory_remark(plan: MemoryPlan, what: str) -> Remark:
    """Return where the training data are kept, and the largest memory of SHRED's training on them.

    Args:
        plan: the memory.
        what: the training data, such as ``the ensemble``.
    """
    size, peak, limit = map(memory_text, (plan.ensemble, plan.peak, plan.limit))
    place = "kept on disk and read in parts" if plan.is_on_disk else "kept in memory"
    return Remark(
        f"Training takes about {peak} of memory, and may take {limit}: {what} of {size} is {place}"
    )


def ensemble_memory_remarks(context: CheckContext) -> Iterator[Remark]:
    """Return the memory of the ensembles, and whether the disk has space for them.

    Raises:
        InputError: they do not fit into the limit, or onto the disk.
    """
    config, system, fitted = context.config, context.system, len(context.split.fit.times)
    recorded = len(context.times) + sum(len(other.times) for other in context.others.values())
    plan = memory_of_run(config, system, fitted, recorded)
    yield memory_remark(plan, "the ensemble")
    if plan.is_on_disk:
        size = bytes_on_disk(config, system, fitted)
        known = context.problem
        scratch = scratch_of(config, "" if known is None else known.recording_sha256)
        scratch.check_space(size)
        yield Remark(f"Both ensembles take {memory_text(size)} in {scratch.root} during the run")
