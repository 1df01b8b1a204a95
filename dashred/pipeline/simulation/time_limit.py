"""End a simulation at a deadline."""

from __future__ import annotations

from dashred.core.budget import Deadline
from dashred.core.progress import Report
from dashred.physics.solvers.simulate import Progress


def within(deadline: Deadline, report: Report) -> Progress:
    """Return a callback of a simulation that shows its progress and ends it at a deadline."""

    def progress(done: float) -> None:
        # A simulation that is done is used.
        if done < 1:
            deadline.check()
        report(done, "")

    return progress
