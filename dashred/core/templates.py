"""Documents from Jinja2 templates, which lie in ``templates`` beside the code that fills them."""

from __future__ import annotations

import re
from functools import cache

from jinja2 import Environment, PackageLoader, StrictUndefined, select_autoescape

# Of these nothing is escaped. Every other document is taken for HTML: values out of a configuration
# or a recording must not become markup.
PLAIN = ("md.j2", "yaml.j2")


@cache
def _environment() -> Environment:
    environment = Environment(
        loader=PackageLoader("dashred", ""),
        autoescape=select_autoescape(disabled_extensions=PLAIN, default=True),
        undefined=StrictUndefined,
        trim_blocks=True,
        lstrip_blocks=True,
        keep_trailing_newline=True,
    )
    environment.filters["cell"] = _cell
    return environment


def _cell(text: str) -> str:
    """Keep what Markdown would read as a sign of its own, and each line of a table one line."""
    return re.sub(r"([\\|*_<`~\[])", r"\\\1", " ".join(text.split()))


def render(template: str, **values: object) -> str:
    """Fill in a template.

    Args:
        template: its path in the package: ``reporting/page/templates/report.html.j2``.
        values: what it names; naming anything else is an error.
    """
    return _environment().get_template(template).render(values)
