"""The ``key=value`` arguments of a command, declared as fields of a dataclass.

.. code-block:: python

    @dataclass(frozen=True, kw_only=True)
    class Arguments:
        path: Path = argument(read_path, "FILE.csv", "where to write")
        jobs: int = argument(integer_reader(at_least=1), "2", "processes at once", default="1")

    arguments = Command("dashred example", Arguments, "Writes an example.").read(argv)

The declaration defines the values, the error messages and the usage text.
"""

from __future__ import annotations

import textwrap
from collections.abc import Callable, Iterable, Iterator, Sequence
from dataclasses import dataclass, field, fields
from typing import TYPE_CHECKING, Any, Generic, TypeVar

from dashred.core.errors import InputError, nearest

if TYPE_CHECKING:
    from _typeshed import DataclassInstance

COMMAND_LINE = "command line"
HELP_FLAGS = {"--help", "-h"}
WIDTH = 96
T = TypeVar("T", bound="DataclassInstance")
Reader = Callable[[str], Any]


@dataclass(frozen=True)
class Argument:
    """One argument ``name=value``.

    Attributes:
        attribute: field of the dataclass that holds the value.
        name: the part before ``=``.
        read: converts the part after ``=``; raises a ValueError that describes the problem.
        example: an example of the part after ``=``, for the usage text and for hints.
        help: description, one phrase.
        is_required: whether the command needs the argument.
    """

    attribute: str
    name: str
    read: Reader
    example: str
    help: str
    is_required: bool


def argument(
    read: Reader,
    example: str,
    help: str,
    *,
    name: str = "",
    default: str | None = "",
    factory: Callable[[], Any] | None = None,
) -> Any:
    """Declare an argument as a field of a dataclass.

    Args:
        read: converts text to a value, or raises a ValueError that describes the problem.
        example: an example of the text.
        help: description for the usage text, one phrase.
        name: name of the argument; by default the name of the field.
        default: default as text, or None for the value None. Without it the argument is required.
        factory: returns a default that depends on the environment.
    """
    described = f"{help}; default: {default}" if default else help
    required = default == "" and factory is None
    metadata = {"argument": (name, read, example, described, required)}
    if factory is not None:
        return field(default_factory=factory, metadata=metadata)
    if required:
        return field(metadata=metadata)
    return field(default=None if default is None else read(default), metadata=metadata)


def declared_arguments(kind: type[DataclassInstance]) -> list[Argument]:
    """Return the arguments that a dataclass declares, in order."""
    result = []
    for member in fields(kind):
        if "argument" in member.metadata:
            name, *rest = member.metadata["argument"]
            result.append(Argument(member.name, name or member.name, *rest))
    return result


def key_value_pairs(argv: Iterable[str]) -> Iterator[tuple[str, str]]:
    """Yield the key and the value of each argument, both as text.

    Raises:
        InputError: an argument is not ``key=value``.
    """
    for text in argv:
        key, sign, value = text.partition("=")
        if not sign or not key or key.startswith("-"):
            what = f"expected key=value, got {text!r}"
            raise InputError(what, where=COMMAND_LINE, hint=_hint(text))
        yield key, value


def _hint(text: str) -> str:
    """Return what may have been meant by an argument that is not ``key=value``."""
    bare = text.lstrip("-")
    if "=" in bare.strip("="):
        return f"write {bare}"
    if bare.endswith((".yaml", ".yml")):
        return f"write conf={text} for a configuration; see --help"
    if "." in bare or "/" in bare:
        return f"write path={text} for a file, or the key that it belongs to; see --help"
    return "see --help"


@dataclass(frozen=True)
class Command(Generic[T]):
    """A command with its arguments and its usage text.

    Attributes:
        program: the command as the user types it, such as ``dashred fetch``.
        arguments: the dataclass that declares the arguments.
        about: what the command does.
        rest: help for other ``key=value`` arguments that the command passes on, if it does.
        after: last part of the usage text.
    """

    program: str
    arguments: type[T]
    about: str
    rest: str = ""
    after: str = ""

    def read(self, argv: Sequence[str], *, others: Iterable[str] = ()) -> T:
        """Return the values of the arguments; ``--help`` prints the usage and exits with 0.

        Args:
            argv: the arguments.
            others: further keys that a hint may suggest.

        Raises:
            InputError: an argument is unknown, given twice, empty, missing or invalid.
        """
        if HELP_FLAGS & set(argv):
            print(self.usage(), end="")
            raise SystemExit(0)
        known = {argument.name: argument for argument in declared_arguments(self.arguments)}
        values: dict[str, Any] = {}
        for key, text in key_value_pairs(argv):
            if key not in known:
                hint = nearest(key, [*known, *others])
                raise InputError(f"unknown key {key}", where=COMMAND_LINE, hint=hint)
            if key in values:
                raise InputError(
                    f"{key}= is given twice", where=COMMAND_LINE, hint="keep one of them"
                )
            values[key] = _value(known[key], text)
        if missing := [
            f"{name}=" for name in known if known[name].is_required and name not in values
        ]:
            what = f"{' and '.join(missing)} {'is' if len(missing) == 1 else 'are'} missing"
            raise InputError(what, where=COMMAND_LINE, hint=self._first_line())
        return self.arguments(**{known[key].attribute: value for key, value in values.items()})

    def usage(self) -> str:
        """Return what ``--help`` prints."""
        described = [(f"{a.name}={a.example}", a.help) for a in declared_arguments(self.arguments)]
        if self.rest:
            described.append(("key=value", self.rest))
        indent = max(len(shown) for shown, _ in described) + 5
        rows = [
            textwrap.fill(
                help,
                WIDTH,
                initial_indent=f"  {shown}".ljust(indent),
                subsequent_indent=" " * indent,
                break_on_hyphens=False,
                break_long_words=False,
            )
            for shown, help in described
        ]
        parts = [f"usage: {self._first_line()}", self.about.strip(), "\n".join(rows)]
        return "\n\n".join([*parts, *filter(None, [self.after.strip("\n")])]) + "\n"

    def _first_line(self) -> str:
        """Return the command with its arguments; the optional ones only if all fit in one line."""
        declared = declared_arguments(self.arguments)
        required = [f"{a.name}={a.example}" for a in declared if a.is_required]
        optional = [f"[{a.name}={a.example}]" for a in declared if not a.is_required]
        line = " ".join([self.program, *required, *optional])
        if len(line) <= WIDTH and not self.rest:
            return line
        return " ".join([self.program, *required, "[key=value ...]"])


def _value(argument: Argument, text: str) -> Any:
    hint = f"for example {argument.name}={argument.example}"
    if not text:
        raise InputError(f"{argument.name}= is empty", where=COMMAND_LINE, hint=hint)
    try:
        return argument.read(text)
    except ValueError as error:
        what = f"{argument.name}={text}: {error}"
        raise InputError(what, where=COMMAND_LINE, hint=hint) from None
