"""A command as a program that steps states."""

from __future__ import annotations

import shutil
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from tempfile import TemporaryDirectory

from jinja2 import Template

from dashred.core.errors import InputError
from dashred.core.threads import thread_count
from dashred.physics.external.adapter import ANY_TIME, SINGLE, Unread, Way
from dashred.physics.external.adapters.command import netcdf_files, text_files
from dashred.physics.external.adapters.command.layout import Layout
from dashred.physics.external.adapters.command.process import run_process
from dashred.physics.external.adapters.patience import Patience
from dashred.physics.external.kept.contents import files_sha256
from dashred.physics.external.state_batch import Array, ProgramError, StateBatch

INPUT, OUTPUT = "{input}", "{output}"


class CommandAdapter:
    """A command that reads states from one file and writes them to another.

    With a template it steps one state per process, in text; else any number, in NetCDF.
    """

    def __init__(
        self,
        words: Sequence[str],
        template: Template | None,
        files: Sequence[Path],
        seconds: float,
        layout: Layout,
        place: str,
    ) -> None:
        """Set the command.

        Args:
            words: program and arguments, with ``{input}`` and ``{output}``.
            template: of the input as text.
            files: of the program, whose contents belong to its hash.
            seconds: time limit for one state.
            layout: of the files.
            place: location of its key.
        """
        self._words, self._template, self._files = tuple(words), template, tuple(files)
        self._patience, self._layout = Patience(seconds), layout
        self._writer = netcdf_files.InputWriter(layout)
        self.fields, self.place = layout.fields, place
        self.name = " ".join(Path(w).name if Path(w).is_absolute() else w for w in words)

    @property
    def alone(self) -> tuple[Way, ...]:
        """See :class:`dashred.physics.external.adapter.Adapter`."""
        return (ANY_TIME,) if self._template is None else (SINGLE,)

    @property
    def together(self) -> tuple[Way, ...]:
        """See :class:`dashred.physics.external.adapter.Adapter`."""
        return (ANY_TIME,) if self._template is None else ()

    @property
    def at_once(self) -> int:
        """See :class:`dashred.physics.external.adapter.Adapter`."""
        return thread_count()

    def call(self, batch: StateBatch, way: Way, time: Unread | None = None) -> Array:
        """See :meth:`dashred.physics.external.adapter.Adapter.call`."""
        with TemporaryDirectory(prefix="dashred-", ignore_cleanup_errors=True) as name:
            folder, layout = Path(name), self._layout
            kind = "nc" if self._template is None else "txt"
            given, result = folder / f"input.{kind}", folder / f"output.{kind}"
            if self._template is None:
                self._writer.write(given, batch)
            else:
                text_files.write_input(given, batch, layout, self._template)
            words = [w.replace(INPUT, str(given)).replace(OUTPUT, str(result)) for w in self._words]
            with self._patience.call(len(batch)) as longest:
                run_process(words, folder, longest)
            if not result.is_file():
                raise ProgramError("ends without an error, but writes no output")
            if self._template is None:
                return netcdf_files.read_output(result, len(batch), layout)
            return text_files.read_output(result, layout)

    def sha256(self) -> str:
        """See :meth:`dashred.physics.external.adapter.Adapter.sha256`."""
        return files_sha256(self._words, self._files)


@dataclass(frozen=True)
class CommandWords:
    """What a command is opened from.

    Attributes:
        words: program and arguments, with ``{input}`` and ``{output}``.
        template: path of the template of its input; None for NetCDF.
        seconds: time limit for one state.
        layout: of the files.
        place: location of its key.
    """

    words: tuple[str, ...]
    template: str | None
    seconds: float
    layout: Layout
    place: str


def open_command(given: CommandWords) -> CommandAdapter:
    """Find the program of a command, and read its template.

    Raises:
        InputError: there is no such program or template, or a name belongs to the files.
    """
    words, template, place = given.words, given.template, given.place
    program = shutil.which(words[0])
    if program is None:
        what = "is not executable" if Path(words[0]).exists() else "does not exist"
        hint = f"chmod +x {words[0]}" if "exec" in what else "build it, or give its path: ./NAME"
        raise InputError(f"the program {words[0]} {what}", where=place, hint=hint)
    for mark in (INPUT, OUTPUT):
        if not any(mark in word for word in words):
            hint = f'for example [./solver, --in, "{INPUT}", --out, "{OUTPUT}"]'
            raise InputError(f"the command has no {mark}", where=place, hint=hint)
    files = [Path(program), *(Path(word) for word in words[1:] if Path(word).is_file())]
    read = None if template is None else text_files.read_template(template)
    if template is not None:
        files.append(Path(template))
    return CommandAdapter([program, *words[1:]], read, files, given.seconds, given.layout, place)
