"""The ``key=value`` words of a command line, declared as the fields of a dataclass.

.. code-block:: python

    @dataclass(frozen=True, kw_only=True)
    class Words:
        path: Path = word(read_path, "FILE.csv", "where to write")
        jobs: int = word(whole(at_least=1), "2", "processes at once", default="1")

    words = Command("dashred example", Words, "Writes an example.").read(argv)

The same declaration gives the values, the errors and the usage text.
"""

from __future__ import annotations

import textwrap
from collections.abc import Callable, Iterable, Iterator, Sequence
from dataclasses import dataclass, field, fields
from typing import TYPE_CHECKING, Any, Generic, TypeVar

from dashred.core.errors import InputError, nearest

if TYPE_CHECKING:
    from _typeshed import DataclassInstance

PLACE = "command line"
HELP = {"--help", "-h"}
WIDTH = 96
T = TypeVar("T", bound="DataclassInstance")
Reader = Callable[[str], Any]


@dataclass(frozen=True)
class Word:
    """One word.

    Attributes:
        attribute: the field that holds its value.
        name: the part before ``=``.
        read: turns the part after it into a value; a ValueError says what is wrong with it.
        shape: an example of what follows ``=``, for the usage text and for hints.
        help: one phrase.
        required: whether the command needs it.
    """

    attribute: str
    name: str
    read: Reader
    shape: str
    help: str
    required: bool


def word(
    read: Reader,
    shape: str,
    help: str,
    *,
    name: str = "",
    default: str | None = "",
    factory: Callable[[], Any] | None = None,
) -> Any:
    """Declare one word as a field of a dataclass.

    Args:
        read: turns text into a value, or raises a ValueError that says what is wrong.
        shape: an example of the text.
        help: one phrase for the usage text.
        name: of the word, where it is not that of the field.
        default: as text; None for the value None. Without it the word is required.
        factory: of a default that depends on the surroundings.
    """
    told = f"{help}; default: {default}" if default else help
    required = default == "" and factory is None
    metadata = {"word": (name, read, shape, told, required)}
    if factory is not None:
        return field(default_factory=factory, metadata=metadata)
    if required:
        return field(metadata=metadata)
    return field(default=None if default is None else read(default), metadata=metadata)


def declared(kind: type[DataclassInstance]) -> list[Word]:
    """Return the words that a dataclass declares, in its order."""
    found = []
    for member in fields(kind):
        if "word" in member.metadata:
            name, *rest = member.metadata["word"]
            found.append(Word(member.name, name or member.name, *rest))
    return found


def pairs(argv: Iterable[str]) -> Iterator[tuple[str, str]]:
    """Yield the key and the text of each word.

    Raises:
        InputError: a word is not ``key=value``.
    """
    for text in argv:
        key, sign, value = text.partition("=")
        if not sign or not key or key.startswith("-"):
            hint = f"write {text.lstrip('-')}" if sign and key.strip("-") else "see --help"
            raise InputError(f"expected key=value, got {text!r}", where=PLACE, hint=hint)
        yield key, value


@dataclass(frozen=True)
class Command(Generic[T]):
    """What a command is called, what it takes, and what it says about itself.

    Attributes:
        program: what a user types before the words, ``dashred fetch``.
        words: the dataclass that declares them.
        about: what the command does.
        rest: help for ``key=value``, where other words are passed on; they are not read here.
        after: the end of the usage text.
    """

    program: str
    words: type[T]
    about: str
    rest: str = ""
    after: str = ""

    def read(self, argv: Sequence[str], *, others: Iterable[str] = ()) -> T:
        """Return the values of the words; ``--help`` prints the usage and exits with 0.

        Args:
            argv: the words.
            others: keys that a hint may suggest too.

        Raises:
            InputError: a word is unknown, given twice, empty, missing or cannot be read.
        """
        if HELP & set(argv):
            print(self.usage(), end="")
            raise SystemExit(0)
        known = {one.name: one for one in declared(self.words)}
        values: dict[str, Any] = {}
        for key, text in pairs(argv):
            if key not in known:
                hint = nearest(key, [*known, *others])
                raise InputError(f"unknown key {key}", where=PLACE, hint=hint)
            if key in values:
                raise InputError(f"{key}= is given twice", where=PLACE, hint="keep one of them")
            values[key] = _value(known[key], text)
        if missing := [f"{name}=" for name in known if known[name].required and name not in values]:
            what = f"{' and '.join(missing)} {'is' if len(missing) == 1 else 'are'} missing"
            raise InputError(what, where=PLACE, hint=self._first_line())
        return self.words(**{known[key].attribute: value for key, value in values.items()})

    def usage(self) -> str:
        """Return what ``--help`` prints."""
        told = [(f"{one.name}={one.shape}", one.help) for one in declared(self.words)]
        if self.rest:
            told.append(("key=value", self.rest))
        indent = max(len(shown) for shown, _ in told) + 5
        rows = [
            textwrap.fill(
                help,
                WIDTH,
                initial_indent=f"  {shown}".ljust(indent),
                subsequent_indent=" " * indent,
                break_on_hyphens=False,
                break_long_words=False,
            )
            for shown, help in told
        ]
        parts = [f"usage: {self._first_line()}", self.about.strip(), "\n".join(rows)]
        return "\n\n".join([*parts, *filter(None, [self.after.strip("\n")])]) + "\n"

    def _first_line(self) -> str:
        """Return the command with its words, the optional ones only where all fit in a line."""
        words = declared(self.words)
        needed = [f"{one.name}={one.shape}" for one in words if one.required]
        others = [f"[{one.name}={one.shape}]" for one in words if not one.required]
        line = " ".join([self.program, *needed, *others])
        if len(line) <= WIDTH and not self.rest:
            return line
        return " ".join([self.program, *needed, "[key=value ...]"])


def _value(known: Word, text: str) -> Any:
    hint = f"for example {known.name}={known.shape}"
    if not text:
        raise InputError(f"{known.name}= is empty", where=PLACE, hint=hint)
    try:
        return known.read(text)
    except ValueError as error:
        what = f"{known.name}={text}: {error}"
        raise InputError(what, where=PLACE, hint=hint) from None
