"""Split of the data into fit, validation and test parts."""

from __future__ import annotations

from collections.abc import Iterator

from dashred.pipeline.check.context import CheckContext
from dashred.pipeline.check.remark import Remark, shortened


def splits_remarks(context: CheckContext) -> Iterator[Remark]:
    """Describe what a run with this seed holds out."""
    split = context.split
    yield Remark(split.note[0].upper() + split.note[1:].rstrip("."))
    if context.recording is not None:
        for role, names in (("Validation", split.validate), ("Test", split.test)):
            if names:
                yield Remark(f"{role} sensors: {shortened(list(names))}")
    for episode in context.problem.whole if context.problem else ():
        yield Remark(f"Held-out episode: {episode.name}; its first tenth determines its start")
    if not split.test:
        yield Remark(
            "No sensor is held out: only later times can show an improvement",
            "ok",
            "with 5 or more sensors some are held out; splits.sensors.test=[NAME] holds one out",
        )
