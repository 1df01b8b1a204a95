"""The figures of one run: under known names, and none that an earlier run has left."""

from __future__ import annotations

from pathlib import Path

import pytest

from dashred.reporting.figures.figure_names import (
    OF_EQUATIONS,
    OF_THE_TRUTH,
    PROOF,
    WHERE,
    is_figure,
)
from dashred.reporting.figures.gallery import Gallery
from dashred.reporting.figures.style import new_figure


def test_a_page_shows_what_was_drawn_and_nothing_else_that_lies_there(tmp_path: Path) -> None:
    (tmp_path / "forcing.png").write_bytes(b"of an earlier run")
    gallery = Gallery(tmp_path)
    for name in ("space_time.png", "where.png"):
        gallery.save(new_figure(1, 1), name)
    assert gallery.drawn == [tmp_path / "space_time.png", tmp_path / "where.png"]
    shown = {place: [*files.values()] for place, files in gallery.captioned(OF_EQUATIONS).items()}
    assert shown.pop(WHERE) == [tmp_path / "where.png"]
    assert shown.pop(PROOF) == [tmp_path / "space_time.png"]
    assert not any(shown.values())


def test_a_figure_that_no_later_run_would_clear_is_not_drawn(tmp_path: Path) -> None:
    with pytest.raises(ValueError, match=r"'new\.png'"):
        Gallery(tmp_path).save(new_figure(1, 1), "new.png")
    assert not list(tmp_path.iterdir())


@pytest.mark.parametrize(
    "name", ["sensor_traces.png", "sensor_traces_2.png", "held_out_episode.png", *OF_THE_TRUTH]
)
def test_every_figure_is_known_by_its_name(name: str) -> None:
    assert is_figure(name)
    assert not is_figure(f"my_{name}") and not is_figure(f"{name}.bak")
