"""Render Jinja2 templates.

Templates are in the folder ``templates`` beside the code that renders them.
"""

from __future__ import annotations

import re
from functools import cache

from jinja2 import Environment, PackageLoader, StrictUndefined, select_autoescape

# These templates are not escaped. All others are HTML, in which values from a configuration or a
# recording must not become markup.
UNESCAPED = ("md.j2", "yaml.j2", "c.j2")


@cache
def _environment() -> Environment:
    environment = Environment(
        loader=PackageLoader("dashred", ""),
        autoescape=select_autoescape(disabled_extensions=UNESCAPED, default=True),
        undefined=StrictUndefined,
        trim_blocks=True,
        lstrip_blocks=True,
        keep_trailing_newline=True,
    )
    environment.filters["cell"] = _cell
    return environment


def _cell(text: str) -> str:
    """Escape the special characters of Markdown, and join lines: a table cell is one line."""
    return re.sub(r"([\\|*_<`~\[])", r"\\\1", " ".join(text.split()))


def render(template: str, **values: object) -> str:
    """Render a template.

    Args:
        template: path in the package, such as ``reporting/page/templates/report.html.j2``.
        values: the variables of the template; any other variable in it is an error.
    """
    return _environment().get_template(template).render(values)
