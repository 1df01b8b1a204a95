"""States as text: a template for the input, and columns of numbers as the output.

The template has the fields, axes, inputs and parameters by name, and t and dt. A field is a number,
or a list over the grid. The output has one line for each grid point, the last axis varying first,
with one column for each field. A first line may name the columns; ``#`` begins a comment.
"""

from __future__ import annotations

from pathlib import Path

import numpy as np
from jinja2 import StrictUndefined, Template, TemplateError
from jinja2.sandbox import SandboxedEnvironment

from dashred.core.errors import InputError
from dashred.physics.external.adapters.command.layout import Layout
from dashred.physics.external.state_batch import Array, ProgramError, StateBatch


def read_template(path: str) -> Template:
    """Read a Jinja2 template.

    Raises:
        InputError: the file does not exist, or is not a template.
    """
    # A template can read what it is given, and call nothing else.
    environment = SandboxedEnvironment(
        undefined=StrictUndefined,
        trim_blocks=True,
        lstrip_blocks=True,
        keep_trailing_newline=True,
        autoescape=False,
    )
    try:
        return environment.from_string(Path(path).read_text(encoding="utf-8"))
    except (OSError, UnicodeError) as error:
        reason = getattr(error, "strerror", None) or error
        raise InputError(f"the template cannot be read: {reason}", where=path) from None
    except TemplateError as error:
        line = getattr(error, "lineno", None)
        raise InputError(f"not a Jinja2 template: {error}", where=f"{path}:{line}") from None


def write_input(path: Path, batch: StateBatch, layout: Layout, template: Template) -> None:
    """Write the input of the one state of a batch.

    Raises:
        ProgramError: the template uses an unknown name, or fails.
    """
    fields = zip(layout.fields, batch.states[0], strict=True)
    values = {
        **{name: places.tolist() for name, (_, places) in layout.coordinates.items()},
        **{name: value.tolist() for name, value in fields},
        **{name: float(value[0]) for name, value in batch.inputs.items()},
        **{name: float(value) for name, value in batch.parameters.items()},
        "t": float(batch.t[0]),
        "dt": float(batch.dt[0]),
    }
    try:
        path.write_text(template.render(values), encoding="utf-8")
    except Exception as error:  # an expression of a template may raise any exception
        names = ", ".join(values)
        what = f"has a template that fails: {type(error).__name__}: {error}"
        raise ProgramError(what, f"it has: {names}") from error


def read_output(path: Path, layout: Layout) -> Array:
    """Return the one state of an output, ``(1, field, *grid)``.

    Raises:
        ProgramError: the output has not one number of each field for each grid point.
    """
    try:
        text = path.read_text(encoding="utf-8")
    except UnicodeError:
        raise ProgramError("writes an output that is not text") from None
    lines = (line.partition("#")[0].replace(",", " ").split() for line in text.splitlines())
    rows = [words for words in lines if words]
    columns = list(range(len(layout.fields)))
    if rows and _number(rows[0][0]) is None:
        names = rows.pop(0)
        if absent := [name for name in layout.fields if name not in names]:
            raise ProgramError(f"writes no column {absent[0]}, but {', '.join(names)}")
        columns = [names.index(name) for name in layout.fields]
    points = int(np.prod(layout.shape))
    if len(rows) != points:
        raise ProgramError(f"writes {len(rows)} lines of numbers instead of {points}")
    values = np.empty((points, len(layout.fields)))
    for index, words in enumerate(rows):
        if len(words) <= max(columns):
            what = f"writes {len(words)} numbers in line {index + 1} of {points}"
            raise ProgramError(f"{what}, instead of one for each of {', '.join(layout.fields)}")
        for place, column in enumerate(columns):
            number = _number(words[column])
            if number is None:
                raise ProgramError(f"writes {words[column]!r} where a number should be")
            values[index, place] = number
    return values.T.reshape(1, len(layout.fields), *layout.shape)


def _number(word: str) -> float | None:
    """Return a number, which Fortran may have written as ``1.5D-03``."""
    try:
        return float(word.upper().replace("D", "E", 1))
    except ValueError:
        return None
