"""The page of the Python API is made from the docstrings, and up to date."""

from __future__ import annotations

import dashred
from dashred.pipeline.api.reference import ORDER, public_objects, render_reference
from tests.conftest import CHECKOUT


def test_the_page_is_up_to_date() -> None:
    """If not: python -m dashred.pipeline.api.reference path=docs/api.md."""
    assert (CHECKOUT / "docs" / "api.md").read_text(encoding="utf-8") == render_reference(
        public_objects(dashred)
    )


def test_every_public_name_is_on_it() -> None:
    assert {*ORDER, "__version__"} == set(dashred.__all__)


def test_arguments_and_errors_are_told() -> None:
    text = render_reference(public_objects(dashred))
    assert "### Problem.discover" in text
    assert "- `seed`: seed of all random numbers; None uses the seed of the configuration." in text
    assert "- `InputError`: there is no recording, or the input is invalid." in text
    assert ":meth:" not in text and "``\n" not in text.replace("```\n", "")
