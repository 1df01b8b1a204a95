"""Tables and figures for the templates."""

from base64 import b64encode
from collections.abc import Collection, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path

# Pixels of a figure per percent of the page width. The scale is the same for all figures, so that
# their text has the same size. The width of a PNG is in its bytes 16 to 20.
PIXELS_PER_PERCENT = 14.4


@dataclass(frozen=True)
class Table:
    """A table of text; ``numbers`` are the indices of right-aligned columns."""

    heads: Sequence[str]
    rows: Sequence[Sequence[str]]
    numbers: Collection[int] = ()


@dataclass(frozen=True)
class Figure:
    """An image embedded in the page: a PNG in base64, and its width in percent."""

    caption: str
    data: str
    width: str


def read_figures(files: Mapping[str, Path]) -> list[Figure]:
    """Read PNG files, given by caption."""
    return [_figure(caption, file.read_bytes()) for caption, file in files.items()]


def _figure(caption: str, png: bytes) -> Figure:
    share = min(100.0, int.from_bytes(png[16:20]) / PIXELS_PER_PERCENT)
    return Figure(caption, b64encode(png).decode("ascii"), f"{share:.0f}" if share else "")
