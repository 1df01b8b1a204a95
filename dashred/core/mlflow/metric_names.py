"""MLflow metric names for terms: readable, and invertible to the expression.

MLflow allows letters, digits, ``_ - . /`` and space. A product of simple factors becomes

    u**3 -> u.pow3    u*lam -> u.lam    d(u, x, 2) -> u_xx    u*lap(u) -> u.lap.of.u

and any other text is spelled out after a leading ``-``: ``u + 1`` becomes ``-u .plus. 1``.
"""

import hashlib
import re
from collections.abc import Iterable

MAX_LENGTH = 118  # two such keys and a short prefix stay within the 250 that MLflow allows
SYMBOLS = {
    "**": "pow",
    "*": "times",
    "/": "over",
    "+": "plus",
    "-": "minus",
    "(": "open",
    ")": "close",
    ",": "comma",
    ".": "dot",
}
WORDS = {word: symbol for symbol, word in SYMBOLS.items()}

NAME = r"[A-Za-z][A-Za-z0-9_]*"
POWER = r"(?:\*\*[1-9][0-9]*)?"
DERIVATIVE = rf"d\((?P<of>{NAME}{POWER}), (?P<axis>[a-z])(?:, (?P<order>[2-9]))?\)"
FACTOR = re.compile(rf"(?P<atom>{DERIVATIVE}|(?:{NAME}\()*(?:{NAME}|[0-9]+)\)*)(?P<power>{POWER})")
SHORT_DERIVATIVE = re.compile(rf"({NAME}(?:\.pow[1-9][0-9]*)?)_(([a-z])\3*)")
SHORT_FACTOR = re.compile(
    rf"(?P<atom>{NAME}\.pow[1-9][0-9]*_[a-z]+|(?:{NAME}\.of\.)*(?:{NAME}|[0-9]+))"
    r"(?:\.pow(?P<power>[1-9][0-9]*))?(?:\.(?!$)|$)"
)


def slug(term: str) -> str:
    """Return the term as part of an MLflow metric name; different terms have different slugs."""
    short = _shorten(term)
    # Use the short form only if it is invertible: a field named u_x is not the derivative u_x.
    return short if short is not None and _lengthen(short) == term else f"-{_spell(term)}"


def unslug(text: str) -> str:
    """Return the term whose slug is ``text``.

    Raises:
        ValueError: no term has this slug.
    """
    term = _unspell(text[1:]) if text.startswith("-") else _lengthen(text)
    if term is None or slug(term) != text:
        raise ValueError(f"not the slug of a term: {text!r}")
    return term


def term_key(term: str) -> str:
    """Return the slug, or its beginning and a hash if it is too long for MLflow."""
    full = slug(term)
    if len(full) <= MAX_LENGTH:
        return full
    digest = hashlib.sha256(term.encode("utf-8", "surrogatepass")).hexdigest()[:16]
    return f"{full[: MAX_LENGTH - 17]}-{digest}"


def metric_name(prefix: str, equation: str, term: str) -> str:
    """Return the metric name of one coefficient: ``alg1/u/u.pow3``."""
    return f"{prefix}/{term_key(equation)}/{term_key(term)}"


def term_table(terms: Iterable[str]) -> dict[str, str]:
    """Return the contents of ``terms.json``: last part of a metric name → expression."""
    return {term_key(term): term for term in terms}


def _shorten(term: str) -> str | None:
    """Return the short form of a product of simple factors; None for any other text."""
    parts, position = [], 0
    while match := FACTOR.match(term, position):
        parts.append(_short_atom(match) + match["power"].replace("**", ".pow"))
        position = match.end() + 1
        if match.end() == len(term):
            return ".".join(parts)
        if term[match.end()] != "*":
            return None
    return None


def _short_atom(match: re.Match[str]) -> str:
    if match["of"] is None:
        return match["atom"].replace("(", ".of.").rstrip(")")
    return f"{match['of'].replace('**', '.pow')}_{match['axis'] * int(match['order'] or 1)}"


def _lengthen(short: str) -> str | None:
    """Return the term of a short form; None if the text is not a short form."""
    factors, position = [], 0
    while match := SHORT_FACTOR.match(short, position):
        power = f"**{match['power']}" if match["power"] else ""
        factors.append(_long_atom(match["atom"]) + power)
        position = match.end()
        if position == len(short):
            return "*".join(factors)
    return None


def _long_atom(atom: str) -> str:
    *functions, argument = atom.split(".of.")
    if match := SHORT_DERIVATIVE.fullmatch(argument):
        order = f", {len(match[2])}" if len(match[2]) > 1 else ""
        argument = f"d({match[1].replace('.pow', '**')}, {match[3]}{order})"
    return "".join(f"{name}(" for name in functions) + argument + ")" * len(functions)


def _spell(text: str) -> str:
    """Keep letters, digits, ``_`` and space; spell out the rest as ``.word.`` or ``.x2f.``."""

    def word(match: re.Match[str]) -> str:
        symbol = match.group()
        return f".{SYMBOLS.get(symbol) or f'x{ord(symbol):x}'}."

    return re.sub(r"\*\*|[^A-Za-z0-9_ ]", word, text, flags=re.DOTALL)


def _unspell(text: str) -> str | None:
    pieces = re.split(r"\.([a-z][0-9a-z]*)\.", text)
    for index in range(1, len(pieces), 2):
        word = pieces[index]
        if word not in WORDS and not re.fullmatch(r"x[0-9a-f]{1,6}", word):
            return None
        pieces[index] = WORDS.get(word) or chr(int(word[1:], 16))
    return "".join(pieces)
