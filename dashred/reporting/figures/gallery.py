"""The figures of one run, without others in its folder."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from pathlib import Path

from matplotlib.figure import Figure

from dashred.reporting.figures.figure_names import Captions, is_figure
from dashred.reporting.figures.style import save_figure


class Gallery:
    """A folder of figures, and the list of those that were drawn.

    Attributes:
        drawn: the files, in the order in which they were drawn.
    """

    def __init__(self, folder: Path) -> None:
        """Hold the folder; nothing is drawn yet."""
        self.folder = folder
        self.drawn: list[Path] = []

    def save(self, figure: Figure, name: str) -> None:
        """Save a figure under one of the names by which a later run clears it away.

        Raises:
            ValueError: :mod:`dashred.reporting.figures.figure_names` has no such name.
        """
        if not is_figure(name):
            raise ValueError(f"no figure of ours is called {name!r}")
        save_figure(figure, self.folder / name)
        self.drawn.append(self.folder / name)

    def draw(self, figures: Mapping[str, Callable[[], Figure]]) -> None:
        """Draw and save figures by name, one after another."""
        for name, draw in figures.items():
            self.save(draw(), name)

    def captioned(self, captions: Captions) -> dict[str, dict[str, Path]]:
        """Return those that were drawn, by caption, by place in the page."""
        return {
            place: {
                caption: self.folder / name
                for caption, name in files.items()
                if self.folder / name in self.drawn
            }
            for place, files in captions.items()
        }
