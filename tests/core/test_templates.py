"""Templates: HTML is escaped, and an undefined name is an error."""

from __future__ import annotations

import re
from pathlib import Path

import pytest
from jinja2 import DictLoader, UndefinedError

import dashred
from dashred.core import templates

PACKAGE = Path(dashred.__file__).parent
TEMPLATES = sorted(
    path.relative_to(PACKAGE).as_posix()
    for path in PACKAGE.rglob("templates/*")
    if path.suffix == ".j2"
)
EVIL = "<script>alert('&')</script>"


@pytest.fixture
def render(monkeypatch: pytest.MonkeyPatch):
    """Render one line as a template with the given name."""
    environment = templates._environment()

    def one(name: str, source: str, **values: object) -> str:
        loader = DictLoader({name: source})
        monkeypatch.setattr(templates, "_environment", lambda: environment.overlay(loader=loader))
        return templates.render(name, **values)

    return one


@pytest.mark.parametrize("name", ["a.html.j2", "a.html", "a.j2", "a.svg.j2"])
def test_what_is_not_known_to_be_plain_text_is_escaped(name: str, render) -> None:
    assert render(name, "{{ text }}", text=EVIL) == (
        "&lt;script&gt;alert(&#39;&amp;&#39;)&lt;/script&gt;"
    )


@pytest.mark.parametrize("name", ["a.md.j2", "a.yaml.j2"])
def test_plain_text_is_not(name: str, render) -> None:
    assert render(name, "{{ text }}", text=EVIL) == EVIL


def test_interpolation_is_refused(render) -> None:
    assert render("a.md.j2", "{{ text }}", text="{{ 1 + 1 }}") == "{{ 1 + 1 }}"


def test_a_name_without_a_value_is_an_error(render) -> None:
    with pytest.raises(UndefinedError, match="'text' is undefined"):
        render("a.html.j2", "{{ text }}")


def test_a_cell_of_a_table_is_one_line_without_signs_of_markdown(render) -> None:
    told = render("a.md.j2", "| {{ text | cell }} |", text="u|v\n**2 <b> a_b `c` [d] ~e~")
    assert told == r"| u\|v \*\*2 \<b> a\_b \`c\` \[d] \~e\~ |"


@pytest.mark.parametrize("name", TEMPLATES)
def test_every_template_compiles_and_says_what_it_is_of(name: str) -> None:
    environment = templates._environment()
    environment.get_template(name)
    assert name.endswith((".html.j2", *(f".{kind}" for kind in templates.UNESCAPED)))


@pytest.mark.parametrize("name", TEMPLATES)
def test_no_template_switches_escaping_off(name: str) -> None:
    source = (PACKAGE / name).read_text(encoding="utf-8")
    assert not re.search(r"\|\s*safe\b|\bautoescape\b", source)
