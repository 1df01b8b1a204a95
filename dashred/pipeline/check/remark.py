"""What a check has to say."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal


@dataclass(frozen=True)
class Remark:
    """One thing found.

    Attributes:
        says: in plain words.
        kind: fine, doubtful (look at it before you trust a run), left to do, or wrong (a run
            would refuse it).
        hint: what to do about it.
    """

    says: str
    kind: Literal["fine", "doubtful", "to do", "wrong"] = "fine"
    hint: str | None = None


def doubtful(says: str, hint: str | None = None) -> Remark:
    """Return a remark that somebody should look at."""
    return Remark(says, "doubtful", hint)


def counted(count: int, thing: str) -> str:
    """Return ``1 sensor``, ``2 sensors``."""
    return f"{count} {thing}{'' if count == 1 else 's'}"


def some(names: list[str], most: int = 4) -> str:
    """Return the first names and how many more there are: ``s1, s2 and 7 more``."""
    if len(names) <= most + 1:
        return ", ".join(names)
    return f"{', '.join(names[:most])} and {len(names) - most} more"
