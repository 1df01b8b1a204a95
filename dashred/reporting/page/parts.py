"""The parts that a page is put together from: sections, tables, figures, paragraphs."""

from base64 import b64encode
from collections.abc import Collection, Iterable, Mapping, Sequence
from html import escape
from pathlib import Path

# So many pixels of a figure are one per cent of the page's width: letters of all figures are of one
# size then. A PNG's width stands in its bytes 16 to 20.
WHOLE = 14.4


def section(title: str, *parts: str) -> str:
    """A heading and what follows it; nothing where nothing follows."""
    body = "\n".join(part for part in parts if part)
    return f"<section>\n<h2>{escape(title)}</h2>\n{body}\n</section>" if body else ""


def paragraphs(lines: Iterable[str], kind: str = "") -> str:
    """A paragraph for each line."""
    opened = f'<p class="{kind}">' if kind else "<p>"
    return "\n".join(f"{opened}{escape(line.strip())}</p>" for line in lines)


def table(
    heads: Sequence[str], rows: Iterable[Sequence[str]], *, numbers: Collection[int] = ()
) -> str:
    """A table; the columns of numbers, counted from 0, stand on the right."""

    def row(cells: Sequence[str], tag: str) -> str:
        found = (
            f"<{tag}{' class=n' if index in numbers else ''}>{escape(cell)}</{tag}>"
            for index, cell in enumerate(cells)
        )
        return f"<tr>{''.join(found)}</tr>"

    head = f"<thead>{row(heads, 'th')}</thead>" if heads else ""
    body = "\n".join(row(cells, "td") for cells in rows)
    kind = "" if heads else ' class="facts"'
    return f'<div class="scroll"><table{kind}>{head}<tbody>\n{body}\n</tbody></table></div>'


def figures(files: Mapping[str, Path]) -> str:
    """Figures by caption, each a PNG file that is put into the page."""
    return "\n".join(_figure(caption, file) for caption, file in files.items())


def _figure(caption: str, file: Path) -> str:
    png, text = file.read_bytes(), escape(caption)
    data, share = b64encode(png).decode("ascii"), min(100.0, int.from_bytes(png[16:20]) / WHOLE)
    size = f' style="width: {share:.0f}%"' if share else ""
    image = f'<img alt="{text}"{size} src="data:image/png;base64,{data}">'
    return f"<figure><figcaption>{text}</figcaption>{image}</figure>"
