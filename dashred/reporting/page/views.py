"""Tables and figures as the templates are given them."""

from base64 import b64encode
from collections.abc import Collection, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path

# So many pixels of a figure are one per cent of the page's width: letters of all figures are of one
# size then. A PNG's width stands in its bytes 16 to 20.
WHOLE = 14.4


@dataclass(frozen=True)
class Table:
    """A table of texts; the columns of numbers, counted from 0, stand on the right."""

    heads: Sequence[str]
    rows: Sequence[Sequence[str]]
    numbers: Collection[int] = ()


@dataclass(frozen=True)
class Figure:
    """A picture that is put into the page: a PNG in base64, and its width in per cent."""

    caption: str
    data: str
    width: str


def figures(files: Mapping[str, Path]) -> list[Figure]:
    """Read figures, PNG files by caption."""
    return [_figure(caption, file.read_bytes()) for caption, file in files.items()]


def _figure(caption: str, png: bytes) -> Figure:
    share = min(100.0, int.from_bytes(png[16:20]) / WHOLE)
    return Figure(caption, b64encode(png).decode("ascii"), f"{share:.0f}" if share else "")
