"""`report.html`: one page that holds all a reader needs, and refers to nothing outside it."""

from base64 import b64encode
from collections.abc import Iterable, Mapping, Sequence
from html import escape
from pathlib import Path
from typing import Any

from dashred.reporting.summary import METHODS
from dashred.reporting.verdict_words import VERDICTS, alternative_in_words, verdict_lines
from dashred.typeset import number, percent, pretty, rounded

STYLE = """
:root { color-scheme: light; --ink: #1a1a1a; --soft: #5a5a5a; --line: #dedede; --key: #0072b2; }
body { font: 16px/1.55 system-ui, sans-serif; color: var(--ink); background: #fff;
       max-width: 60rem; margin: 0 auto; padding: 2.5rem 1.25rem 4rem; }
h1 { font-size: 1.7rem; line-height: 1.25; margin: 0 0 .3rem; }
h2 { font-size: 1.15rem; margin: 2.6rem 0 .7rem; border-bottom: 1px solid var(--line); }
p, li { max-width: 46rem; }
.about, figcaption, .note { color: var(--soft); font-size: .88rem; }
.verdict { border-left: 5px solid var(--key); background: #f3f8fb; padding: .8rem 1.1rem;
           margin: 1.4rem 0; }
.verdict p { margin: .35rem 0; }
.verdict p:first-child { font-weight: 650; font-size: 1.08rem; }
.scroll { overflow-x: auto; }
table { border-collapse: collapse; font-size: .93rem; font-variant-numeric: tabular-nums; }
th, td { padding: .4rem .9rem .4rem 0; text-align: left; vertical-align: top; }
th { font-weight: 600; color: var(--soft); border-bottom: 1px solid var(--ink); }
td { border-bottom: 1px solid var(--line); }
td.n, th.n { text-align: right; }
code { font: .9em ui-monospace, monospace; overflow-wrap: anywhere; }
figure { margin: 1.6rem 0; } img { max-width: 100%; height: auto; }
details { margin: .6rem 0; } pre { white-space: pre-wrap; font-size: .82rem; }
"""
COMPARED = ("simulation", "before", "before_refit", "shred", "dashred", "after")


PROOFS = {
    "test_sensors": "test sensors",
    "heldout_time": "held-out time",
    "heldout_restarted": "held-out time, from a state fitted just before it",
}


def write_html(
    path: Path,
    findings: Mapping[str, Any],
    figures: Mapping[str, Path],
    summary: str,
) -> None:
    """Write the report, whole or not at all.

    Args:
        path: where.
        findings: of ``findings.json``.
        figures: PNG files by caption, in the order in which a reader should meet them.
        summary: the printed summary, for the end of the page.
    """
    title = findings["input"]["config"].get("system", {}).get("title", "The system")
    parts = [
        f"<h1>{escape(title)}: what the simulation leaves out</h1>",
        '<p class="about">Found by dashred from sensors alone.</p>',
        _verdict(findings),
        _terms(findings["terms"] or []),
        _alternatives(findings["alternatives"] or []),
        _verification(findings["fit"]),
        *(_figure(caption, file) for caption, file in figures.items()),
        _provenance(findings),
        f"<details><summary>The printed summary</summary><pre>{escape(summary)}</pre></details>",
    ]
    body = "\n".join(part for part in parts if part)
    page = (
        '<!doctype html>\n<html lang="en">\n<head>\n<meta charset="utf-8">\n'
        '<meta name="viewport" content="width=device-width, initial-scale=1">\n'
        f"<title>{escape(title)}: dashred</title>\n<style>{STYLE}</style>\n</head>\n"
        f"<body>\n{body}\n</body>\n</html>\n"
    )
    partial = path.with_name(f".{path.name}.partial")
    partial.write_text(page, encoding="utf-8")
    partial.replace(path)


def _verdict(findings: Mapping[str, Any]) -> str:
    lines = verdict_lines(findings)
    if not lines:
        return ""
    head = VERDICTS.get(findings["verdict"], findings["verdict"])
    told = [f"{head[:1].upper()}{head[1:]}.", *(line.strip() for line in lines[1:])]
    return f'<div class="verdict">{"".join(f"<p>{escape(line)}</p>" for line in told)}</div>'


def _terms(terms: Sequence[Mapping[str, Any]]) -> str:
    if not terms:
        return ""
    rows = []
    for term in terms:
        value, std = rounded(term["coefficient"], term["std"])
        low, high = (rounded(end, term["std"])[0] for end in term["ci95"])
        where = "parameter" if term["equation"] is None else f"equation of {term['equation']}"
        what = pretty(term["term"])
        if term["equation"] is None:
            value = f"{number(term['from'])} → {rounded(term['to'], term['std'])[0]}"
        interval, included = f"{low} … {high}", percent(term["inclusion"])
        rows.append([where, what, value, std, interval, included, term["says"]])
    heads = ["where", "term", "coefficient", "std", "95 % interval", "probability", "in words"]
    return "<h2>The law</h2>" + _table(heads, rows, numbers={2, 3, 4, 5})


def _alternatives(alternatives: Sequence[Mapping[str, Any]]) -> str:
    if not alternatives:
        return ""
    rows = [
        [
            alternative_in_words(other),
            number(float(f"{other['delta_bic']:.3g}")),
            "yes" if other["rival"] else "no",
            "yes" if other["same_as_best"] else "no",
        ]
        for other in alternatives
    ]
    heads = ["law", "ΔBIC", "fits about as well", "same at these sensors"]
    return "<h2>Other explanations</h2>" + _table(heads, rows, numbers={1})


def _verification(fit: Mapping[str, Any]) -> str:
    kinds = {
        kind: title
        for kind, title in PROOFS.items()
        if any(fit[kind].get(method) is not None for method in COMPARED)
    }
    known = {method: [fit[kind].get(method) for kind in kinds] for method in COMPARED}
    rows = [
        [METHODS[method], *("–" if value is None else f"{value:.3g}" for value in values)]
        for method, values in known.items()
        if any(value is not None for value in values)
    ]
    if not rows:
        return ""
    note = '<p class="note">RMSE in standard deviations; nothing was fitted to them.</p>'
    heads = ["", *kinds.values()]
    return "<h2>Proof</h2>" + note + _table(heads, rows, numbers={*range(1, len(heads))})


def _figure(caption: str, file: Path) -> str:
    data = b64encode(file.read_bytes()).decode("ascii")
    text = escape(caption)
    image = f'<img alt="{text}" src="data:image/png;base64,{data}">'
    return f"<figure>{image}<figcaption>{text}</figcaption></figure>"


def _provenance(findings: Mapping[str, Any]) -> str:
    source, fit = findings["input"], findings["fit"]
    rows = [
        ["configuration, sha256", source["config_sha256"]],
        ["recording, sha256", source["recording_sha256"]],
        ["seed", str(source["seed"])],
        ["versions", ", ".join(f"{name} {v}" for name, v in sorted(source["versions"].items()))],
    ]
    if sizes := source["library_size"]:
        rows.append(["library", ", ".join(f"{n} terms for {f}" for f, n in sizes.items())])
    if splits := source["splits"]:
        roles = {
            "inputs": "SHRED's input",
            "extra": "fit",
            "validate": "validation",
            "test": "test",
        }
        told = [f"{role}: {', '.join(splits[key])}" for key, role in roles.items() if splits[key]]
        rows.append(["sensors", "; ".join(told)])
        rows.append(["fitted up to time", number(splits["time_end"])])
    if fit["chi2"] is not None:
        rows.append(["χ² per sample of the fit", number(fit["chi2"])])
    if fit["unexplained"] is not None:
        rows.append(["misfit beyond the noise", percent(fit["unexplained"])])
    if findings["corrected"]:
        rows.append(["corrected simulation", findings["corrected"]])
    return "<h2>Provenance</h2>" + _table([], rows, numbers=set())


def _table(heads: Sequence[str], rows: Iterable[Sequence[str]], *, numbers: set[int]) -> str:
    def row(cells: Sequence[str], tag: str) -> str:
        found = (
            f"<{tag}{' class=n' if index in numbers else ''}>{escape(cell)}</{tag}>"
            for index, cell in enumerate(cells)
        )
        return f"<tr>{''.join(found)}</tr>"

    head = f"<thead>{row(heads, 'th')}</thead>" if heads else ""
    body = "\n".join(row(cells, "td") for cells in rows)
    return f'<div class="scroll"><table>{head}<tbody>\n{body}\n</tbody></table></div>'
