"""The figures of one run."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from pathlib import Path

from matplotlib.figure import Figure

from dashred.core.budget import NEVER, Deadline
from dashred.reporting.figures.figure_names import Captions, is_figure
from dashred.reporting.figures.style import save_figure


class Gallery:
    """A folder of figures, and the list of the figures that were drawn.

    Attributes:
        drawn: the files, in order.
    """

    def __init__(self, folder: Path) -> None:
        self.folder = folder
        self.drawn: list[Path] = []

    def save(self, figure: Figure, name: str) -> None:
        """Save a figure.

        A later run deletes figures by name, so the name must be in
        :mod:`dashred.reporting.figures.figure_names`.

        Raises:
            ValueError: it is not.
        """
        if not is_figure(name):
            raise ValueError(f"{name!r} is not the name of a figure")
        save_figure(figure, self.folder / name)
        self.drawn.append(self.folder / name)

    def draw(
        self, figures: Mapping[str, Callable[[], Figure]], deadline: Deadline = NEVER
    ) -> list[str]:
        """Draw and save figures, given by name; return those for which there was no time."""
        left_out = []
        for name, draw in figures.items():
            if deadline.is_over:
                left_out.append(name)
            else:
                self.save(draw(), name)
        return left_out

    def captioned(self, captions: Captions) -> dict[str, dict[str, Path]]:
        """Return the figures that were drawn, by caption, by section."""
        return {
            section: {
                caption: self.folder / name
                for caption, name in files.items()
                if self.folder / name in self.drawn
            }
            for section, files in captions.items()
        }
