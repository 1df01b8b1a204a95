"""Documents from Jinja2 templates, which lie in ``templates`` beside the code that fills them."""

from __future__ import annotations

from functools import cache

from jinja2 import Environment, PackageLoader, StrictUndefined, select_autoescape

from dashred.core.formatting import number

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
    environment.filters["number"] = number
    return environment


def render(template: str, **values: object) -> str:
    """Fill in a template.

    Args:
        template: its path in the package: ``reporting/page/templates/report.html.j2``.
        values: what it names; naming anything else is an error.
    """
    return _environment().get_template(template).render(values)
