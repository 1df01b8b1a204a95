"""What a configuration leaves to be filled in."""

from __future__ import annotations

from collections.abc import Iterator

from dashred.config import Config
from dashred.config.checks.placeholders import unfinished_lines
from dashred.pipeline.check.remark import Remark


def left_to_do(config: Config) -> Iterator[Remark]:
    """Tell the lines of the system's file that are marked, and equations that are 0."""
    marked = unfinished_lines(config)
    for line, says in marked.items():
        yield Remark(f"{line}: {says}", "to do")
    for field, text in config.system.equations.items():
        where = config.where(f"system.equations.{field}")
        if is_zero(text) and where not in marked:
            says = f"{where}: the equation of {field} is 0: nothing moves it"
            yield Remark(says, "to do", "write its right-hand side, unless it never changes")


def still(config: Config) -> list[str]:
    """Return the fields that nothing moves."""
    return [field for field, text in config.system.equations.items() if is_zero(text)]


def is_zero(text: str) -> bool:
    """Whether an equation is nothing but a zero."""
    return text.strip() in ("0", "0.0", "-0")
