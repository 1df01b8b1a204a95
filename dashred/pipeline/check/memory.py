"""What a run needs of memory and of disk space."""

from __future__ import annotations

import math
from collections.abc import Iterator

from dashred.core.stated.memory import memory_text
from dashred.pipeline.check.context import CheckContext
from dashred.pipeline.check.remark import Remark
from dashred.pipeline.input.scratch_folder import scratch_of
from dashred.pipeline.simulation.ensemble_memory import MemoryPlan, plan_memory


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
    config, system = context.config, context.system
    values = len(system.fields) * math.prod(system.grid.shape)
    recorded = len(context.times) + sum(len(other.times) for other in context.others.values())
    fitted = len(context.split.fit.times)
    members = max(config.simulation.members, config.surrogate.members)
    plan = plan_memory(config, values, fitted, recorded, members)
    yield memory_remark(plan, "the ensemble")
    if plan.is_on_disk:
        sha256 = "" if context.problem is None else context.problem.recording_sha256
        counts = {
            "ensemble": config.simulation.members,
            "corrected ensemble": config.surrogate.members,
        }
        scratch = scratch_of(config, sha256)
        size = 8 * values * fitted * sum(counts.values())
        scratch.check_space("", size)
        yield Remark(f"Both ensembles take {memory_text(size)} in {scratch.root} during the run")
