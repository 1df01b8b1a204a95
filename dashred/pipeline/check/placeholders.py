"""Lines of a configuration that are still to be filled in."""

from __future__ import annotations

from collections.abc import Iterator

from dashred.config import Config
from dashred.config.checks.placeholders import unfinished_lines
from dashred.pipeline.check.remark import Remark


def placeholder_remarks(config: Config) -> Iterator[Remark]:
    """Yield the marked lines of the configuration file and the equations that are 0."""
    marked = unfinished_lines(config)
    for line, task in marked.items():
        yield Remark(f"{line}: {task}", "to do")
    for field, text in config.system.equations.items():
        where = config.where(f"system.equations.{field}")
        if is_zero(text) and where not in marked:
            text = f"{where}: the equation of {field} is 0, so {field} is constant"
            yield Remark(text, "to do", "write its right-hand side, unless it is constant")


def zero_equations(config: Config) -> list[str]:
    """Return the fields whose equation is 0."""
    return [field for field, text in config.system.equations.items() if is_zero(text)]


def is_zero(text: str) -> bool:
    """Whether the text of an equation is 0."""
    return text.strip() in ("0", "0.0", "-0")
