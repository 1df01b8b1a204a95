"""Who is fitted, who validates and who tests."""

from __future__ import annotations

from collections.abc import Iterator

from dashred.pipeline.check.context import CheckContext
from dashred.pipeline.check.remark import Remark, some


def about_splits(situation: CheckContext) -> Iterator[Remark]:
    """Tell what a run with this seed will hold out."""
    split = situation.split
    yield Remark(split.note[0].upper() + split.note[1:].rstrip("."))
    if situation.recording is not None:
        for role, names in (("validate", split.validate), ("test", split.test)):
            if names:
                yield Remark(f"To {role}: {some(list(names))}")
    for whole in situation.problem.whole if situation.problem else ():
        yield Remark(f"Held out whole: episode {whole.name}, but for a tenth that tells its start")
    if not split.test:
        yield Remark(
            "No sensor is held out: an improvement can be shown in later times alone",
            "fine",
            "from 5 sensors on some are held out; splits.sensors.test=[NAME] names one before",
        )
